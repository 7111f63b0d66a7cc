"""The solved forces are given back to duct, catheter and tools, in one kernel."""

from __future__ import annotations

from services.mechanics.arrays import FloatArray
from services.mechanics.bodies import duct_loads
from services.mechanics.bodies.catheter import spread_rod_forces
from services.mechanics.bodies.duct_loads import DuctLoads
from services.mechanics.bodies.forceps.tool_body import ToolArrays, correct_proxies
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address
from services.mechanics.contact.state import ContactState, state_at
from services.mechanics.contact.tool_loads import load_tools
from services.mechanics.rod import contact_response
from services.mechanics.rod.contact_energy_gain import pay_for_change
from services.mechanics.rod.free_step import FreeStep, step_at
from services.mechanics.rod.implicit_kernels import Addresses, Motion
from services.mechanics.rod.model import model_at, work_at


@kernel
def give_forces(
    addresses: tuple[Address[ContactState], Address[DuctLoads], Address[FreeStep], Address[ToolArrays]],
    rod: Addresses,
    motion: Motion,
    step: tuple[float, bool],
    dt_s: float,
    tool_force: FloatArray,
    pays: bool,
) -> bool:
    """Correct the end of the step of all bodies; ``tool_force`` (2, 4) takes the generalised forces on the tools.

    ``pays`` is whether all that the catheter stores is known here, as it is without twist, see `contact_energy_gain`.
    ``motion`` and ``step`` are those of `contact_response.correct`; False, and nothing corrected, where that is False.
    """
    state, catheter = state_at(addresses[0]), step_at(addresses[2])
    rows, k = state.rows, state.rows.n_contacts
    forces = state.force_n[:k]
    spread_rod_forces(rows.rod_node[:k], rows.rod_weight[:k], forces, catheter.contact)
    if not contact_response.correct(rod, motion, catheter.contact, step):
        return False
    if pays:
        pay_for_change(model_at(rod[0]), work_at(rod[1]), catheter, motion, step[0])
    duct_loads.correct(addresses[1], rows.duct_node[:k], rows.duct_weight[:k], forces, dt_s)
    load_tools(addresses[0], tool_force)
    correct_proxies(addresses[3], tool_force)
    return True
