"""Grasps that slip: grip friction limits the force of a hold."""

from __future__ import annotations

from trocar.services.mechanics.effects.base import Effect
from trocar.services.mechanics.world import World


class GraspSlip(Effect):
    """Limit every hold to 2 mu N of its grasp; without this effect a grasp holds until it is opened.

    A hold at its limit slides against the force, which only dissipates energy.
    """

    def set_friction(self, world: World, dt_s: float) -> None:
        """Set the holds' limits, which are infinite without this effect."""
        world.holds.limit_rows()
