"""Messages that physics publishes after a step."""

from __future__ import annotations

from typing import Annotated, Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from trocar.protocol import Frame
from trocar.protocol.arrays import Array
from trocar.protocol.bodies import Catheter, ContactForces, Duct, PhysicsState
from trocar.protocol.bodies.haptics import TOOL_COLUMNS, TOOL_OPENING, TOOL_POSITION
from trocar.protocol.bodies.physics import (
    NO_STONES,
    REACTION_COLUMNS,
    REACTION_CONTACTS,
    REACTION_FORCE,
    REACTION_GRASP_STIFFNESS,
    REACTION_GRASP_TORQUE,
    REACTION_HOLDS,
    REACTION_MOMENT,
    REACTION_OPENING,
    REACTION_POSITION,
    REACTION_PROXY,
    REACTION_PROXY_OPENING,
    REACTION_STIFFNESS,
)
from trocar.services.mechanics.arrays import ByteArray, FloatArray
from trocar.services.mechanics.collision.pairs import DUCT_TRIANGLE, NO_TOOL
from trocar.services.mechanics.compiled import inlined_kernel, kernel
from trocar.services.mechanics.compiled.struct import Address, Struct, reader
from trocar.services.mechanics.contact.identity import TARGET_KIND, part_of
from trocar.services.mechanics.contact.laws import TOUCHES
from trocar.services.mechanics.contact.rows import ContactRows, rows_at
from trocar.services.mechanics.scene.tools import N_TOOLS
from trocar.services.mechanics.simulation import Simulation
from trocar.services.runtime.bus.bus import Bus
from trocar.services.runtime.loop.flat_view import flat_view

#: Ticks between measurements of the inserted length (60 Hz) for picture and score; one costs a third of a tick.
_INSERTED_EVERY = 16
# Kinds of contacts on the wire.
TOOL_DUCT, TOOL_CATHETER, CATHETER_DUCT, OTHER = range(4)
_TOOL_BYTES = TOOL_COLUMNS * np.dtype(float).itemsize


class Sent(Struct):
    """Tools' results, hands of the solve and c contacts, with their tables in wire format."""

    force: Annotated[FloatArray, N_TOOLS, 3]
    port_moment: Annotated[FloatArray, N_TOOLS, 3]
    proxy_position: Annotated[FloatArray, N_TOOLS, 3]
    stiffness: Annotated[FloatArray, N_TOOLS, 3, 3]
    grasp_torque: Annotated[FloatArray, N_TOOLS]
    grasp_stiffness: Annotated[FloatArray, N_TOOLS]
    proxy_jaw_angle: Annotated[FloatArray, N_TOOLS]
    contact_force: Annotated[FloatArray, "c", 3]
    kind: Annotated[ByteArray, "c"]
    hands: Annotated[FloatArray, N_TOOLS, TOOL_COLUMNS]
    table: Annotated[FloatArray, N_TOOLS, REACTION_COLUMNS]


sent_at = reader(Sent)


class Outputs:
    """Publishes the state of one simulation; `feel` writes into ``felt`` (2, REACTION_COLUMNS)."""

    def __init__(self, simulation: Simulation, basis_hash: str, felt: FloatArray | None = None) -> None:
        self._simulation = simulation
        self._basis_hash = basis_hash
        self._inserted_m, self._n_contacts = 0.0, 0
        self._inserted_is_old, self._inserted_period = True, -1
        self._said: PhysicsState | None = None
        self._with_spheres = [each for each in simulation.effects.values() if each.sphere_radii_m()]
        self._kinds = np.zeros(simulation.contacts.capacity, np.int8)
        self._table = np.zeros((N_TOOLS, REACTION_COLUMNS)) if felt is None else felt
        hands = np.zeros((N_TOOLS, TOOL_COLUMNS))
        self._hands = flat_view(hands).cast("B")
        results = simulation.tool_results
        self._sent = Sent(
            force=results.force_n,
            port_moment=results.port_moment_nm,
            proxy_position=results.proxy_position_m,
            stiffness=results.stiffness_n_m,
            grasp_torque=results.grasp_torque_nm,
            grasp_stiffness=results.grasp_stiffness_nm_rad,
            proxy_jaw_angle=results.proxy_jaw_angle_rad,
            contact_force=simulation.system.force_n,
            kind=self._kinds,
            hands=hands,
            table=self._table,
        )

    def publish(self, bus: Bus, answered: Frame, *, valid: bool) -> None:
        """Send the state that answers a frame of tools, as a single frame, since each one wakes haptics.

        A tick at which the rig's time stands has one state, whatever is measured meanwhile.
        """
        if self._said is None or answered.body.tick != self._said.tick:
            self._said = self.state(answered.body.tick, answered.body.tools)
        state = self._said
        period = state.tick // _INSERTED_EVERY  # steps of two ticks may all end at odd ticks
        self._inserted_is_old |= period != self._inserted_period
        self._inserted_period = period
        bus.publish("physics.state", state, origin_ns=answered.origin_ns, valid=valid and answered.valid)

    def publish_moment(self, bus: Bus, answered: Frame, *, valid: bool) -> None:
        """Send the state that was published last once more, with all that is measured of it now."""
        if self._said is not None:
            self._inserted_m = self._simulation.inserted_length_m
            catheter = msgspec.structs.replace(self._said.catheter, inserted_length_m=self._inserted_m)
            moment = msgspec.structs.replace(self._said, catheter=catheter)
            bus.publish("physics.moment", moment, origin_ns=answered.origin_ns, valid=valid and answered.valid)

    def forget(self) -> None:
        """Discard rarely measured values, because the scene has restarted."""
        self._inserted_m, self._inserted_is_old, self._said = 0.0, True, None

    def measure_inserted(self) -> bool:
        """Measure values that are only displayed, between two ticks, for the next frames; return whether it was due."""
        if not self._inserted_is_old:
            return False
        self._inserted_is_old = False
        self._inserted_m = self._simulation.inserted_length_m
        return True

    def state(self, tick: int, tools: Array) -> PhysicsState:
        """Return the state after a step, and the reaction on each of `tools`, for which it was solved."""
        n_tools, contacts = self.feel(tools), self._contacts()
        return PhysicsState(
            tick=tick,
            tools=pack_contiguous(self._table[:n_tools]),
            duct=self._duct(),
            catheter=self._catheter(),
            contacts=contacts,
            ticks_per_step=self._simulation.rung.ticks_per_step,
            stones_m=self._stones(),
        )

    def feel(self, tools: Array) -> int:
        """Write the reaction on each of `tools` into the first rows of the table; return their number."""
        hands = tools.data[: len(self._hands)]
        self._hands[: len(hands)] = hands
        rows, holds = self._simulation.contacts, self._simulation.holds.rows
        self._n_contacts = tabulate(rows.address, self._sent.address, holds.start, holds.stop)
        return len(hands) // _TOOL_BYTES

    def _duct(self) -> Duct:
        duct = self._simulation.duct
        n, state = duct.n_loads, duct.state
        return Duct(
            basis_hash=self._basis_hash,
            q=pack_contiguous(state.q),
            q_rate=pack_contiguous(state.qdot),
            load_node=pack_contiguous(duct.load_nodes[:n], "<i4"),
            load_force_n=pack_contiguous(duct.load_force_n[:n]),
        )

    def _catheter(self) -> Catheter:
        catheter = self._simulation.catheter
        return Catheter(
            position_m=pack_contiguous(catheter.state.position_m),
            velocity_m_s=pack_contiguous(catheter.state.velocity_m_s),
            radius_m=catheter.radius_m,
            inserted_length_m=self._inserted_m,
        )

    def _stones(self) -> Array:
        if not self._with_spheres:
            return NO_STONES
        return pack_contiguous(np.concatenate([each.sphere_places_m() for each in self._with_spheres]))

    def _contacts(self) -> ContactForces:
        s, n = self._simulation, self._n_contacts
        return ContactForces(
            kind=pack_contiguous(self._kinds[:n], "|i1"),
            point_m=pack_contiguous(s.contacts.point_m[:n]),
            force_n=pack_contiguous(s.system.force_n[:n]),
            max_penetration_m=s.max_penetration_m,
        )


def pack_contiguous(values: NDArray[Any], dtype: str = "<f8") -> Array:
    """Return the same as `trocar.protocol.arrays.pack` of a contiguous array of this dtype, in half the time."""
    return Array(dtype, values.shape, values.tobytes())


@kernel
def tabulate(rows_address: Address[ContactRows], sent_address: Address[Sent], first_hold: int, after_holds: int) -> int:
    """Write the reaction on each tool into its row of the table, and the kind of each contact; return their number."""
    sent, rows = sent_at(sent_address), rows_at(rows_address)
    table, hands = sent.table, sent.hands
    for tool in range(table.shape[0]):
        for axis in range(3):
            table[tool, REACTION_FORCE + axis] = sent.force[tool, axis]
            table[tool, REACTION_MOMENT + axis] = sent.port_moment[tool, axis]
            table[tool, REACTION_PROXY + axis] = sent.proxy_position[tool, axis]
            table[tool, REACTION_POSITION + axis] = hands[tool, TOOL_POSITION + axis]
            for other in range(3):
                table[tool, REACTION_STIFFNESS + 3 * axis + other] = sent.stiffness[tool, axis, other]
        table[tool, REACTION_GRASP_TORQUE] = sent.grasp_torque[tool]
        table[tool, REACTION_GRASP_STIFFNESS] = sent.grasp_stiffness[tool]
        table[tool, REACTION_OPENING] = hands[tool, TOOL_OPENING]
        table[tool, REACTION_PROXY_OPENING] = sent.proxy_jaw_angle[tool]
        table[tool, REACTION_CONTACTS] = table[tool, REACTION_HOLDS] = 0.0
    _count(rows, sent, first_hold, after_holds)
    return rows.n_contacts


@inlined_kernel
def _count(rows: ContactRows, sent: Sent, first_hold: int, after_holds: int) -> None:
    """Write the kind of each row for the wire, and count each tool's contacts and holds."""
    tool, duct_weight, force, kinds = rows.tool, rows.duct_weight, sent.contact_force, sent.kind
    for row in range(rows.n_contacts):
        on_duct = duct_weight[row, 0] != 0.0 or duct_weight[row, 1] != 0.0 or duct_weight[row, 2] != 0.0
        of_tool = tool[row] != NO_TOOL
        if not of_tool:
            kinds[row] = CATHETER_DUCT if on_duct and TOUCHES[rows.law[row]] else OTHER
            continue
        # A squeezed wall's row moves no node, so only its identity tells the body.
        is_wall = rows.identity[row] > 0 and part_of(rows.identity[row], TARGET_KIND) == DUCT_TRIANGLE
        kinds[row] = TOOL_DUCT if on_duct or is_wall else TOOL_CATHETER
        if first_hold <= row < after_holds:
            sent.table[tool[row], REACTION_HOLDS] += 1.0
        elif force[row, 0] != 0.0 or force[row, 1] != 0.0 or force[row, 2] != 0.0:
            sent.table[tool[row], REACTION_CONTACTS] += 1.0
