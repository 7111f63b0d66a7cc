"""The Delassus operator of a straight wall, a catheter by implicit steps and the couplings, in one kernel."""

from __future__ import annotations

from services.mechanics.arrays import FloatArray, IntArray
from services.mechanics.bodies.catheter import CatheterTouch, list_particles, touch_at
from services.mechanics.bodies.duct_loads import DuctLoads, loads_at
from services.mechanics.bodies.forceps.tool_body import ToolArrays, tools_at
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address
from services.mechanics.contact.delassus import add_rod_compliance, add_tool_compliance, rotate_to_contact_frames
from services.mechanics.contact.spheres import add_sphere_compliance
from services.mechanics.contact.state import ContactState, state_at
from services.mechanics.reduction.node_compliance import NodeArrays, weigh_blocks
from services.mechanics.rod.contact_response import compliance, factor_for_contacts
from services.mechanics.rod.model import RodModel, RodWork, work_at

# What `assemble` returns: done; blocks of the wall are missing and nothing is done; the catheter's matrix is not SPD.
# The last stands for a wall or a catheter of another kind.
ASSEMBLED, MISSING, NOT_DEFINITE, NO_KERNEL = 1, 0, -1, -2


@kernel
def assemble(
    state_address: Address[ContactState],
    duct_addresses: tuple[Address[DuctLoads], Address[NodeArrays]],
    rod_addresses: tuple[Address[CatheterTouch], Address[RodModel], Address[RodWork]],
    tools_address: Address[ToolArrays],
    step: tuple[float, bool],
) -> int:
    """Write the compliances of all bodies into W, in the contacts' frames.

    ``step`` is its length and whether the catheter's matrix is factorised.
    """
    state, duct, touch = state_at(state_address), loads_at(duct_addresses[0]), touch_at(rod_addresses[0])
    rows, k, (dt_s, is_factored) = state.rows, state.rows.n_contacts, step
    W = state.delassus[: 9 * k * k].reshape(3 * k, 3 * k)
    if not weigh_blocks(duct_addresses[1], (rows.duct_node[:k], rows.duct_weight[:k]), duct.gains[0], W):
        return MISSING
    count = list_particles(rows.rod_node[:k], rows.rod_weight[:k], touch.slot, touch.particles)
    between = touch.compliance[: 9 * count * count].reshape(3 * count, 3 * count)
    if count > 0:
        if not (is_factored or factor_for_contacts(rod_addresses[1:], dt_s)):
            return NOT_DEFINITE
        band = work_at(rod_addresses[2]).band
        compliance(rod_addresses[1], band, dt_s**2, touch.columns, touch.particles[:count], between)
    _add_body_compliances(state, (touch.slot, between), tools_at(tools_address).compliance)
    return ASSEMBLED


@kernel
def add_body_compliances(
    state_address: Address[ContactState], catheter: tuple[IntArray, FloatArray], tools: FloatArray
) -> None:
    """Add what other bodies give way to the duct's compliance, and turn W into the contacts' frames.

    In the lower blocks of W, world axes, the duct's is there. ``catheter`` are slots of its particles and compliance
    (3 p, 3 p) between them, ``tools`` (2, 4) those of the couplings.
    """
    _add_body_compliances(state_at(state_address), catheter, tools)


@kernel
def _add_body_compliances(state: ContactState, catheter: tuple[IntArray, FloatArray], tools: FloatArray) -> None:
    size = 3 * state.rows.n_contacts
    W = state.delassus[: size * size].reshape(size, size)
    add_rod_compliance(state.rows, catheter[0], catheter[1], state.rod_points, W)
    add_tool_compliance(state.rows, tools, W)
    add_sphere_compliance(state.rows, state.geometry.spheres, W)
    rotate_to_contact_frames(state.rows, W)
