"""Torsion of the catheter, with a material frame along it."""

from __future__ import annotations

from services.mechanics.effects.base import Effect


class Twist(Effect):
    """The catheter gets its torsional stiffness GJ and one director per segment; rest curvature turns with them.

    It acts inside the catheter's integrator, which is built with a frame only where this effect is named.
    """
