"""Grasps that slip: a hold carries what the grip friction allows and no more."""

from __future__ import annotations

from services.mechanics.effects.base import Effect
from services.mechanics.world import World


class GraspSlip(Effect):
    """Limit every hold to 2 mu N of its grasp; without this effect a grasp holds until it is opened.

    A hold at its limit slides against the force, which only takes energy out.
    """

    def set_friction(self, world: World, dt_s: float) -> None:
        """Write the holds' limits over the unlimited ones."""
        world.holds.limit_rows()
