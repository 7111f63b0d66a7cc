"""Contact forces from the compliance in contact space: no stiffness of contact, no penetration at rest."""

from __future__ import annotations

from services.mechanics.arrays import FloatArray, IntArray
from services.mechanics.compiled import kernel
from services.mechanics.contact.delassus import (
    add_modal_compliance,
    add_rod_compliance,
    add_tool_compliance,
    rotate_to_contact_frames,
)
from services.mechanics.contact.free_motion import free_motion
from services.mechanics.contact.laws.law import ContactProblem
from services.mechanics.contact.solver import solve_contacts
from services.mechanics.contact.stages import finish
from services.mechanics.contact.state import state_at
from services.mechanics.contact.strategies.strategy import AddCompliance, ContactStrategy


class ImplicitStrategy(ContactStrategy):
    r"""Solve :math:`u^+ = u_{free} + W f` and the contact laws together, by PGS sweeps and Newton steps."""

    acts_in_next_step = False
    knows_stiffness = True

    def assemble(self, n_modes: int, add_compliance: AddCompliance) -> None:
        """Gather W, along world axes first."""
        bodies, rows = self._bodies, self._state.rows
        duct, catheter, k = bodies.duct, bodies.catheter, rows.n_contacts
        W = self._state.W
        duct.reduced.residual.gather_points(rows.duct_node[:k], rows.duct_weight[:k], W)
        modal = (duct.modes, duct.position_gain[:n_modes])
        rod = catheter.compliance(rows.rod_node[:k], rows.rod_weight[:k])
        add_body_compliances(self._address, modal, catheter.slot, rod, bodies.tools.compliance)
        add_compliance()
        rotate(self._address)

    def solve(self, iterations: int, dt_s: float) -> int:
        """Solve the complementarity problem."""
        settings = self._settings
        sweeps: int = solve_implicitly(self._address, settings.recovery, iterations, settings.tolerance_n)
        return sweeps


@kernel
def add_body_compliances(
    state_address: int, duct: tuple[FloatArray, FloatArray], slot: IntArray, rod: FloatArray, tools: FloatArray
) -> None:
    """Add modes and gains of the duct, catheter (3 p, 3 p) and couplings (2, 4) to the lower blocks of W, world axes.

    What W holds already, the residual compliance, stays.
    """
    state = state_at(state_address)
    size = 3 * state.rows.used[0]
    W = state.delassus[: size * size].reshape(size, size)
    add_modal_compliance(duct[0], duct[1], state.scratch.modes, W)
    add_rod_compliance(state.rows, slot, rod, state.rod_points, W)
    add_tool_compliance(state.rows, tools, W)


@kernel
def rotate(state_address: int) -> None:
    """Rotate W into the contacts' frames."""
    state = state_at(state_address)
    size = 3 * state.rows.used[0]
    rotate_to_contact_frames(state.rows, state.delassus[: size * size].reshape(size, size))


@kernel
def solve_implicitly(state_address: int, recovery: float, iterations: int, tolerance_n: float) -> int:
    """Find the contact forces from W and return the number of sweeps."""
    state = state_at(state_address)
    rows = state.rows
    k = rows.used[0]
    free_motion(rows, recovery, state.motion)
    problem = ContactProblem(
        state.delassus[: 9 * k * k].reshape(3 * k, 3 * k),
        state.motion[: 3 * k],
        rows.force_n[:k].reshape(3 * k),
        rows.law[:k],
        rows.friction[:k],
        rows.force_limit_n[:k],
        state.scratch.change,
    )
    sweeps: int = solve_contacts(problem, (iterations, tolerance_n), state.scratch)
    finish(state)
    return sweeps
