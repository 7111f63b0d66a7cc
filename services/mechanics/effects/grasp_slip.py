"""Grasps that slip: a hold carries what the grip friction allows and no more."""

from __future__ import annotations

from typing import TYPE_CHECKING

from services.mechanics.contact.rows import ContactRows
from services.mechanics.effects.base import Effect

if TYPE_CHECKING:
    from services.mechanics.simulation import Simulation


class GraspSlip(Effect):
    """Limit every hold to 2 mu N of its grasp; without this effect a grasp holds until it is opened.

    A hold at its limit slides against the force, which only takes energy out.
    """

    def set_limits(self, simulation: Simulation, rows: ContactRows) -> None:
        """Write the holds' limits over the unlimited ones."""
        simulation.holds.limit_rows()
