"""Contact forces from the compliance in contact space: no stiffness of contact, no penetration at rest."""

from __future__ import annotations

from services.mechanics.arrays import FloatArray, IntArray
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address
from services.mechanics.contact.anchors import store_anchors
from services.mechanics.contact.delassus import (
    add_rod_compliance,
    add_tool_compliance,
    rotate_to_contact_frames,
)
from services.mechanics.contact.free_motion import free_motion
from services.mechanics.contact.solver import solve_contacts
from services.mechanics.contact.stages import finish
from services.mechanics.contact.state import ContactState, state_at
from services.mechanics.contact.strategies.strategy import AddCompliance, ContactStrategy, Points


class ImplicitStrategy(ContactStrategy):
    r"""Solve :math:`u^+ = u_{free} + W f` and the contact laws together, by PGS sweeps and Newton steps."""

    acts_in_next_step = False
    knows_stiffness = True

    def assemble(self, duct: Points, rod: Points, add_compliance: AddCompliance | None) -> None:
        """Gather W, along world axes first."""
        bodies, catheter = self._bodies, self._bodies.catheter
        bodies.duct.compliance(*duct, self._state.W)
        between = catheter.compliance(*rod)
        is_all = add_compliance is None
        add_body_compliances(self._address, (catheter.slot, between), bodies.tools.compliance, is_all)
        if add_compliance is not None:
            add_compliance()
            rotate(self._address)

    def solve(self, iterations: int, dt_s: float) -> int:
        """Solve the complementarity problem."""
        settings = self._settings
        sweeps: int = solve_implicitly(self._address, (settings.recovery, dt_s), (iterations, settings.tolerance_n))
        return sweeps


@kernel
def add_body_compliances(
    state_address: Address[ContactState], catheter: tuple[IntArray, FloatArray], tools: FloatArray, is_all: bool
) -> None:
    """Add what catheter and couplings (2, 4) give way to the duct's compliance in the lower blocks of W, world axes.

    ``catheter`` are slots of its particles and compliance (3 p, 3 p) between them. If that is all, W is turned into the
    contacts' frames.
    """
    state = state_at(state_address)
    size = 3 * state.rows.n_contacts
    W = state.delassus[: size * size].reshape(size, size)
    add_rod_compliance(state.rows, catheter[0], catheter[1], state.rod_points, W)
    add_tool_compliance(state.rows, tools, W)
    if is_all:
        rotate_to_contact_frames(state.rows, W)


@kernel
def rotate(state_address: Address[ContactState]) -> None:
    """Rotate W into the contacts' frames."""
    state = state_at(state_address)
    size = 3 * state.rows.n_contacts
    rotate_to_contact_frames(state.rows, state.delassus[: size * size].reshape(size, size))


@kernel
def solve_implicitly(
    state_address: Address[ContactState], recovery: tuple[float, float], effort: tuple[int, float]
) -> int:
    """Find the contact forces from W and return the number of sweeps; see `free_motion` and `solve_contacts`."""
    state = state_at(state_address)
    size = 3 * state.rows.n_contacts
    W = state.delassus[: size * size].reshape(size, size)
    free_motion(state.rows, recovery[0], recovery[1], state.problem.motion)
    sweeps: int = solve_contacts(state.problem, W, effort, state.scratch)
    finish(state)
    store_anchors(state.problem, state.slides, state.memory.elastic_m)
    return sweeps
