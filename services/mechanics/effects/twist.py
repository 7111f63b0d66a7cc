"""Torsion of the catheter, with a material frame along it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.bodies.catheter import round_tube
from trocar.services.mechanics.bodies.sections import end_softness, joint_curvature
from trocar.services.mechanics.effects.base import Effect
from trocar.services.mechanics.rod import RodProperties


class Twist(Effect):
    """The catheter gets its torsional stiffness GJ and one director per segment; rest curvature turns with them.

    It acts inside the catheter's integrator, which is built with a frame only where this effect is named.
    """

    def modify_rod(self, rod: RodProperties) -> RodProperties:
        """Return the rod with GJ and the scene's rest curvature."""
        catheter = self.scene.catheter
        curvature = np.array(catheter.rest_curvature_1_m) if catheter.rest_curvature_1_m else None
        stiffness: float | FloatArray = round_tube(catheter).torsional_stiffness_n_m2()
        if catheter.sections:
            stiffness = stiffness * end_softness(catheter)
            bent = joint_curvature(catheter, "rest_curvature_1_m")
            curvature = bent if curvature is None else curvature + (0.0 if bent is None else bent)
        return replace(rod, torsional_stiffness_n_m2=stiffness, rest_curvature_1_m=curvature)
