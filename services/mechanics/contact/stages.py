"""Stages before and after a contact solve. Each is one kernel, which reads the contact state from its address."""

from __future__ import annotations

from trocar.services.mechanics.arrays import BoolArray, FloatArray
from trocar.services.mechanics.bodies import duct_loads
from trocar.services.mechanics.bodies.catheter import spread_rod_forces
from trocar.services.mechanics.bodies.duct_loads import DuctLoads, gather_kept, loads_at
from trocar.services.mechanics.bodies.forceps.tool_body import ToolArrays, correct_proxies
from trocar.services.mechanics.compiled import inlined_kernel, kernel
from trocar.services.mechanics.compiled.struct import Address
from trocar.services.mechanics.compiled.vectors import put_row
from trocar.services.mechanics.compiled.vectors import row as vector
from trocar.services.mechanics.contact import admissible
from trocar.services.mechanics.contact.free_motion import subtract_duct_motion
from trocar.services.mechanics.contact.rows import ContactRows, in_world
from trocar.services.mechanics.contact.sliding import begin_slides, store_slides
from trocar.services.mechanics.contact.state import ContactState, state_at
from trocar.services.mechanics.contact.tool_loads import load_tools
from trocar.services.mechanics.contact.warm_start import recall_forces, store_forces
from trocar.services.mechanics.reduction.node_compliance import NodeArrays
from trocar.services.mechanics.rod import contact_response
from trocar.services.mechanics.rod.contact_energy_gain import remove_energy_gain
from trocar.services.mechanics.rod.free_step import FreeStep, step_at
from trocar.services.mechanics.rod.implicit_kernels import Addresses, Motion
from trocar.services.mechanics.rod.model import model_at, work_at


@kernel
def complete_rows(state_address: Address[ContactState], displacement: FloatArray, motion: FloatArray) -> None:
    """Complete gaps and slips (`subtract_duct_motion`), and recall the forces of the last tick (`recall_forces`).

    ``displacement`` and ``motion`` (k, 3) are those of the duct at the contact points, in m.
    """
    state = state_at(state_address)
    subtract_duct_motion(state.rows, displacement, motion, 0)
    recall_forces(state.memory, state.rows, state.geometry.wall.vertices)
    begin_slides(state.memory, state.rows, 0)


@kernel
def complete_new_rows(
    state_address: Address[ContactState], displacement: FloatArray, motion: FloatArray, first: int
) -> None:
    """Complete the rows from ``first`` on as `complete_rows` does, but leave their forces at zero."""
    state = state_at(state_address)
    subtract_duct_motion(state.rows, displacement, motion, first)
    state.memory.found[first : state.rows.n_contacts] = False
    begin_slides(state.memory, state.rows, first)


@kernel
def gather_and_complete(
    state_address: Address[ContactState], duct_address: Address[DuctLoads], kept_address: Address[NodeArrays]
) -> bool:
    """Gather the displacement and motion of a linear wall at the rows' points, and do as `complete_rows`.

    Return False, with nothing done, if the wall's arrays hold no entry for one of the nodes.
    """
    state, duct = state_at(state_address), loads_at(duct_address)
    k = state.rows.n_contacts
    if not gather_kept(duct, kept_address, state.rows.duct_node[:k], state.rows.duct_weight[:k]):
        return False
    complete_rows(state_address, duct.displacement, duct.motion)
    return True


@kernel
def finish(state: ContactState) -> None:
    """Write sliding flags and forces along world axes, and store what the next step begins with."""
    write_results(state.rows, state.slides, state.force_n)
    store_forces(state.memory, state.rows, state.force_n, state.geometry.wall.vertices)
    store_slides(state.memory, state.problem, state.slides)


@inlined_kernel
def write_results(rows: ContactRows, slides: BoolArray, force_n: FloatArray) -> None:
    """Write whether forces are at the limit of their law (k,), and forces on first bodies along world axes (k, 3)."""
    for row in range(rows.n_contacts):
        slides[row] = admissible.slides(rows, row)
        put_row(force_n, row, in_world(rows, row, vector(rows.force_n, row)))


@kernel
def apply_to_bodies(
    addresses: tuple[Address[ContactState], Address[DuctLoads], Address[FreeStep], Address[ToolArrays]],
    rod: Addresses,
    motion: Motion,
    step: tuple[float, bool],
    dt_s: float,
    tool_force: FloatArray,
    limits_energy: bool,
) -> bool:
    """Correct the end of the step of all bodies; ``tool_force`` (2, 4) receives the generalised forces on the tools.

    ``limits_energy`` is whether to remove the energy gain of a catheter without twist, see `contact_energy_gain`.
    ``motion`` and ``step`` are those of `contact_response.correct`. If that returns False, nothing is corrected, and
    False is returned.
    """
    state, catheter = state_at(addresses[0]), step_at(addresses[2])
    rows, k = state.rows, state.rows.n_contacts
    forces = state.force_n[:k]
    spread_rod_forces(rows.rod_node[:k], rows.rod_weight[:k], forces, catheter.contact)
    if not contact_response.correct(rod, motion, catheter.contact, step):
        return False
    if limits_energy:
        remove_energy_gain(model_at(rod[0]), work_at(rod[1]), catheter, motion, step[0])
    duct_loads.correct(addresses[1], rows.duct_node[:k], rows.duct_weight[:k], forces, dt_s)
    load_tools(addresses[0], tool_force)
    correct_proxies(addresses[3], tool_force)
    return True
