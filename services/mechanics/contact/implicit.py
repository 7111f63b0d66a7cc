"""Implicit contact forces from the Delassus operator: without contact stiffness, and without penetration at rest."""

from __future__ import annotations

import math
from typing import ClassVar

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.bodies.catheter import CatheterTouch, list_particles, touch_at
from trocar.services.mechanics.bodies.duct_loads import DuctLoads, loads_at
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Address
from trocar.services.mechanics.contact.delassus import add_rod_compliance, add_tool_compliance, rotate_to_contact_frames
from trocar.services.mechanics.contact.free_motion import free_motion
from trocar.services.mechanics.contact.geometry import Bodies
from trocar.services.mechanics.contact.passivity import solve_passively
from trocar.services.mechanics.contact.solver import NEAR
from trocar.services.mechanics.contact.spheres import add_sphere_compliance
from trocar.services.mechanics.contact.stages import finish
from trocar.services.mechanics.contact.state import ContactState, state_at
from trocar.services.mechanics.contact.warm_start import store_anchors
from trocar.services.mechanics.reduction.node_compliance import NodeArrays, weigh_blocks
from trocar.services.mechanics.reduction.residual.blocks import own_softness
from trocar.services.mechanics.rod.contact_response import compliance, factor_for_contacts
from trocar.services.mechanics.rod.model import RodModel, RodWork, work_at
from trocar.services.mechanics.scene import ContactSettings

# Tolerance of the wall's motion, as a fraction of its thickness: the tolerance of forces is at most the force that
# moves the softest place of the wall so far. On a wall of 10 um some micronewtons cause a motion of a millimetre.
WALL_TOLERANCE_SHARE = 0.01
# Outcomes of `assemble`: done; nothing done because the wall has not computed some blocks of its compliance; the
# catheter's matrix is not positive definite; there is no kernel for this kind of wall or catheter.
ASSEMBLED, MISSING_BLOCKS, NOT_DEFINITE, NO_KERNEL = 1, 0, -1, -2


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
        state.memory.least_change_n = NEAR * self._tolerance_n

    def assemble(self, first: int = 0, *, anew: bool = False) -> None:
        """Write the Delassus operator W: in one kernel, if there is one for the bodies and it has all blocks.

        Of rows before ``first`` W is there, from when they were all: what these couple is kept. ``anew`` is for
        compiling the other way: as if blocks of the wall's compliance were missing.
        """
        bodies, catheter, outcome = self._bodies, self._bodies.catheter, NO_KERNEL
        keep_blocks(self._address, first)
        rod, kept_address = catheter.plain_integrator, bodies.duct.kept_address
        if rod is not None and kept_address is not None and not anew:
            duct, step = (bodies.duct.loads_address, kept_address), (rod.velocity_gain_s, rod.is_factored)
            outcome = assemble(self._address, duct, (catheter.touch_address, *rod.addresses), step, first)
            if outcome != MISSING_BLOCKS:
                rod.note_factors(outcome == ASSEMBLED)
        if outcome != ASSEMBLED:
            rows = self._state.rows
            anew = anew or outcome == MISSING_BLOCKS
            first = bodies.duct.compliance(*rows.on_duct, self._state.W, first, anew=anew)
            add_body_compliances(self._address, catheter.slot, catheter.compliance(*rows.on_rod), first)

    def solve(self, iterations: int, dt_s: float) -> int:
        """Find forces and sliding states, mostly in at most ``iterations`` sweeps; return the number of sweeps."""
        return solve_implicitly(self._address, (self._settings.recovery, dt_s), (iterations, self._tolerance_n))


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
    free_motion(state.rows, recovery[0], recovery[1], state.problem.free)
    sweeps = solve_passively(state.problem, W, effort, state.ledger, (state.geometry.tools, recovery[1]))
    finish(state)
    store_anchors(state.problem, state.slides, state.memory.elastic_m)
    return sweeps


@kernel
def assemble(
    state_address: Address[ContactState],
    duct_addresses: tuple[Address[DuctLoads], Address[NodeArrays]],
    rod_addresses: tuple[Address[CatheterTouch], Address[RodModel], Address[RodWork]],
    step: tuple[float, bool],
    first: int,
) -> int:
    """Write the compliances of all bodies into W from row ``first`` on, in the contacts' frames; return an outcome.

    ``step`` is (length of the catheter's implicit step in s, whether its matrix is factorised).
    """
    state, duct, touch = state_at(state_address), loads_at(duct_addresses[0]), touch_at(rod_addresses[0])
    rows, k, (dt_s, is_factored) = state.rows, state.rows.n_contacts, step
    W = state.delassus[: 9 * k * k].reshape(3 * k, 3 * k)
    if not weigh_blocks(duct_addresses[1], (rows.duct_node[:k], rows.duct_weight[:k]), duct.gains[0], W, first):
        return MISSING_BLOCKS
    count = list_particles(rows.rod_node[:k], rows.rod_weight[:k], touch.slot, touch.particles)
    rod_compliance = touch.compliance[: 9 * count * count].reshape(3 * count, 3 * count)
    if count > 0:
        if not (is_factored or factor_for_contacts(rod_addresses[1:], dt_s)):
            return NOT_DEFINITE
        band = work_at(rod_addresses[2]).band
        compliance(rod_addresses[1], band, dt_s**2, touch.columns, touch.particles[:count], rod_compliance)
    add_body_compliances(state_address, touch.slot, rod_compliance, first)
    return ASSEMBLED


@kernel
def keep_blocks(state_address: Address[ContactState], first: int) -> None:
    """Move the blocks of the first rows to where they are in the W of all rows, which is packed."""
    state, old = state_at(state_address), 3 * first
    size, packed = 3 * state.rows.n_contacts, state.delassus
    if first == 0 or size == old:
        return
    for i in range(old - 1, -1, -1):  # from the last on: each goes to a place behind it
        for j in range(old - 1, -1, -1):
            packed[i * size + j] = packed[i * old + j]


@kernel
def add_body_compliances(state_address: Address[ContactState], slot: IntArray, rod: FloatArray, first: int) -> None:
    """Add the compliances of the other bodies to the duct's from row ``first`` on, and rotate W into contacts' frames.

    On entry the lower blocks of W hold the duct's compliance along world axes there. ``rod`` (3 p, 3 p) is that between
    the catheter's p touched particles, ``slot`` gives each particle's place in it.
    """
    state = state_at(state_address)
    size = 3 * state.rows.n_contacts
    W = state.delassus[: size * size].reshape(size, size)
    add_rod_compliance(state.rows, slot, rod, state.rod_points, W, first)
    add_tool_compliance(state.rows, state.geometry.tools.compliance, W, first)
    add_sphere_compliance(state.rows, state.geometry.spheres, W, first)
    rotate_to_contact_frames(state.rows, W, first)
