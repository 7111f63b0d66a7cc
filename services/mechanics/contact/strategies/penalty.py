"""The paper's contact response: a spring and damper on the depth of penetration, for comparison."""

from __future__ import annotations

from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address
from services.mechanics.contact import laws
from services.mechanics.contact.free_motion import free_motion
from services.mechanics.contact.geometry import Bodies
from services.mechanics.contact.laws.law import PenaltyGains
from services.mechanics.contact.rows import ContactRows
from services.mechanics.contact.stages import finish
from services.mechanics.contact.state import ContactState, state_at
from services.mechanics.contact.strategies.strategy import ContactStrategy
from services.mechanics.scene import ContactSettings


class PenaltyStrategy(ContactStrategy):
    r"""Explicit forces: gaps are those of the middle of the step and rates those over it, both without contact.

    Stable only while :math:`k \Delta t^2` and :math:`c \Delta t` stay below about the mass that gives way, and a load F
    rests at a depth F / k.
    """

    acts_in_next_step = True
    knows_stiffness = False

    def __init__(self, bodies: Bodies, settings: ContactSettings, state: ContactState) -> None:
        super().__init__(bodies, settings, state)
        self._lightest_kg = float(bodies.catheter.properties.particle_mass_kg().min())

    def assemble(self) -> None:
        """Nothing: a penalty asks no body how it gives way."""

    def solve(self, iterations: int, dt_s: float) -> int:
        """Write the penalty of every contact."""
        settings = self._settings
        lightest_kg = self._lightest_kg
        gains = PenaltyGains(settings.penalty_stiffness_n_m, settings.penalty_damping_n_s_m, dt_s, lightest_kg)
        solve_by_penalty(self._address, gains)
        return 0


@kernel
def solve_by_penalty(state_address: Address[ContactState], gains: PenaltyGains) -> None:
    """Find the contact forces from penetrations."""
    state = state_at(state_address)
    free_motion(state.rows, 1.0, gains.dt_s, state.problem.motion)
    write_penalties(state.rows, gains)
    finish(state)


@kernel
def write_penalties(rows: ContactRows, gains: PenaltyGains) -> None:
    """Write the penalty counterpart of every contact's law into ``rows.force_n``."""
    for row in range(rows.n_contacts):
        slip = rows.slip_m[row]
        normal, first, second = 0.0, 0.0, 0.0
        for axis in range(3):
            normal += rows.frame[row, 0, axis] * slip[axis]
            first += rows.frame[row, 1, axis] * slip[axis]
            second += rows.frame[row, 2, axis] * slip[axis]
        laws.penalty(rows.law[row], rows, row, (normal, first, second), gains)
