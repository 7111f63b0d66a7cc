"""Contact forces from the compliance in contact space: no stiffness of contact, no penetration at rest."""

from __future__ import annotations

import math

from services.mechanics.bodies.forceps.tool_body import ToolArrays, tools_at
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address
from services.mechanics.contact.anchors import store_anchors
from services.mechanics.contact.free_motion import free_motion
from services.mechanics.contact.geometry import Bodies
from services.mechanics.contact.passivity import solve_passively
from services.mechanics.contact.stages import finish
from services.mechanics.contact.state import ContactState, state_at
from services.mechanics.contact.strategies.assembly import ASSEMBLED, MISSING, NO_KERNEL, add_body_compliances, assemble
from services.mechanics.contact.strategies.strategy import ContactStrategy
from services.mechanics.reduction.residual.blocks import own_softness
from services.mechanics.scene import ContactSettings

# A sweep that changes a force by less than moves the wall by this part of its thickness where it gives way most has
# ended a solve: a wall of a hundredth of a millimetre goes by a whole one under some micronewtons.
LEAST_OF_WALL = 0.01


class ImplicitStrategy(ContactStrategy):
    r"""Solve :math:`u^+ = u_{free} + W f` and the contact laws together, by PGS sweeps and Newton steps."""

    acts_in_next_step = False
    knows_stiffness = True

    def __init__(self, bodies: Bodies, settings: ContactSettings, state: ContactState) -> None:
        super().__init__(bodies, settings, state)
        softness_m_n = float(own_softness(bodies.duct.reduced.residual).max(initial=0.0))
        finest_m = LEAST_OF_WALL * 2.0 * bodies.half_thickness_m
        self._tolerance_n = min(settings.tolerance_n, finest_m / softness_m_n if softness_m_n > 0.0 else math.inf)

    def assemble(self) -> None:
        """Gather W."""
        outcome = self._assemble_at_once()
        if outcome != ASSEMBLED:
            self._assemble_by_body(anew=outcome == MISSING)

    def _assemble_at_once(self) -> int:
        """Gather W in one kernel, where the bodies are such that there is one; return what it does, or `NO_KERNEL`."""
        bodies, catheter = self._bodies, self._bodies.catheter
        rod, kept_address = catheter.plain_integrator, bodies.duct.kept_address
        if rod is None or kept_address is None:
            return NO_KERNEL
        duct, tools = (bodies.duct.loads_address, kept_address), bodies.tools.address
        step = (rod.velocity_gain_s, rod.is_factored)
        outcome: int = assemble(self._address, duct, (catheter.touch_address, *rod.addresses), tools, step)
        if outcome != MISSING:
            rod.note_factors(outcome == ASSEMBLED)
        return outcome

    def _assemble_by_body(self, *, anew: bool) -> None:
        bodies, catheter, rows = self._bodies, self._bodies.catheter, self._state.rows
        bodies.duct.compliance(*rows.on_duct, self._state.W, anew=anew)
        between = catheter.compliance(*rows.on_rod)
        add_body_compliances(self._address, (catheter.slot, between), bodies.tools.compliance)

    def compile_kernels(self) -> None:
        """Assemble the rows of the last step as while blocks of the wall are missing."""
        self._assemble_by_body(anew=True)

    def solve(self, iterations: int, dt_s: float) -> int:
        """Solve the complementarity problem."""
        addresses, effort = (self._address, self._bodies.tools.address), (iterations, self._tolerance_n)
        sweeps: int = solve_implicitly(addresses, (self._settings.recovery, dt_s), effort)
        return sweeps


@kernel
def solve_implicitly(
    addresses: tuple[Address[ContactState], Address[ToolArrays]],
    recovery: tuple[float, float],
    effort: tuple[int, float],
) -> int:
    """Find the contact forces from W and return the number of sweeps; see `free_motion` and `solve_passively`."""
    state, hands = state_at(addresses[0]), (tools_at(addresses[1]), recovery[1])
    size = 3 * state.rows.n_contacts
    W = state.delassus[: size * size].reshape(size, size)
    free_motion(state.rows, recovery[0], recovery[1], state.problem.motion)
    sweeps: int = solve_passively(state.problem, W, effort, (state.scratch, state.ledger), hands)
    finish(state)
    store_anchors(state.problem, state.slides, state.memory.elastic_m)
    return sweeps
