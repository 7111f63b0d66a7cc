"""Implicit contact forces from the Delassus operator: without contact stiffness, and without penetration at rest."""

from __future__ import annotations

import math
from typing import ClassVar

from services.mechanics.arrays import FloatArray, IntArray
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address
from services.mechanics.contact.delassus import add_rod_compliance, add_tool_compliance, rotate_to_contact_frames
from services.mechanics.contact.free_motion import free_motion
from services.mechanics.contact.geometry import Bodies
from services.mechanics.contact.passivity import solve_passively
from services.mechanics.contact.spheres import add_sphere_compliance
from services.mechanics.contact.stages import finish
from services.mechanics.contact.state import ContactState, state_at
from services.mechanics.contact.warm_start import store_anchors
from services.mechanics.reduction.residual.blocks import own_softness
from services.mechanics.scene import ContactSettings

# Tolerance of the wall's motion, as a fraction of its thickness: the tolerance of forces is at most the force that
# moves the softest place of the wall so far. On a wall of 10 um some micronewtons cause a motion of a millimetre.
WALL_TOLERANCE_SHARE = 0.01


class ImplicitStrategy:
    r"""Solve :math:`u^+ = u_{free} + W f` and the contact laws together, by PGS sweeps and Newton steps.

    Attributes:
        acts_in_next_step: bool. Whether the forces act on the catheter over the next step instead of the present one.
        keeps_delassus: bool. Whether it assembles the Delassus operator W, from which the local stiffness follows.
    """

    acts_in_next_step: ClassVar[bool] = False
    keeps_delassus: ClassVar[bool] = True

    def __init__(self, bodies: Bodies, settings: ContactSettings, state: ContactState) -> None:
        self._bodies, self._settings, self._state, self._address = bodies, settings, state, state.address
        softness_m_n = float(own_softness(bodies.duct.reduced.residual).max(initial=0.0))
        tolerance_m = WALL_TOLERANCE_SHARE * 2.0 * bodies.half_thickness_m
        self._tolerance_n = min(settings.tolerance_n, tolerance_m / softness_m_n if softness_m_n > 0.0 else math.inf)

    def assemble(self, *, anew: bool = False) -> None:
        """Write the Delassus operator W; ``anew`` is that of `DuctBody.compliance`."""
        bodies, catheter, rows = self._bodies, self._bodies.catheter, self._state.rows
        bodies.duct.compliance(*rows.on_duct, self._state.W, anew=anew)
        rod_compliance = catheter.compliance(*rows.on_rod)
        add_body_compliances(self._address, catheter.slot, rod_compliance)

    def solve(self, iterations: int, dt_s: float) -> int:
        """Find forces and sliding states, mostly in at most ``iterations`` sweeps; return the number of sweeps."""
        effort = iterations, self._tolerance_n
        sweeps: int = solve_implicitly(self._address, (self._settings.recovery, dt_s), effort)
        return sweeps


@kernel
def solve_implicitly(
    state_address: Address[ContactState], recovery: tuple[float, float], effort: tuple[int, float]
) -> int:
    """Find the contact forces from W and return the number of sweeps.

    ``recovery`` is (fraction of an overlap recovered per millisecond, length of the step in s), ``effort`` is that of
    `solve_passively`.
    """
    state = state_at(state_address)
    size = 3 * state.rows.n_contacts
    W = state.delassus[: size * size].reshape(size, size)
    free_motion(state.rows, recovery[0], recovery[1], state.problem.motion)
    sweeps: int = solve_passively(state.problem, W, effort, state.ledger, (state.geometry.tools, recovery[1]))
    finish(state)
    store_anchors(state.problem, state.slides, state.memory.elastic_m)
    return sweeps


@kernel
def add_body_compliances(state_address: Address[ContactState], slot: IntArray, rod: FloatArray) -> None:
    """Add the compliances of the other bodies to the duct's, and rotate W into the contacts' frames.

    On entry the lower blocks of W hold the duct's compliance along world axes. ``rod`` (3 p, 3 p) is that between the
    catheter's p touched particles, ``slot`` gives each particle's place in it.
    """
    state = state_at(state_address)
    size = 3 * state.rows.n_contacts
    W = state.delassus[: size * size].reshape(size, size)
    add_rod_compliance(state.rows, slot, rod, state.rod_points, W)
    add_tool_compliance(state.rows, state.geometry.tools.compliance, W)
    add_sphere_compliance(state.rows, state.geometry.spheres, W)
    rotate_to_contact_frames(state.rows, W)
