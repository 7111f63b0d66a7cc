"""What physics publishes of a step."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from protocol import Frame
from protocol.arrays import pack
from protocol.bodies import Catheter, ContactForces, Duct, PhysicsState, ToolReaction, ToolState
from protocol.vectors import Mat3, Vec3
from services.mechanics.arrays import ByteArray, FloatArray
from services.mechanics.collision.pairs import NO_TOOL
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address
from services.mechanics.contact.rows import ContactRows, rows_at
from services.mechanics.scene.tools import N_TOOLS
from services.mechanics.simulation import Simulation
from services.runtime.bus import Bus

Arrays = tuple[NDArray[Any], ...]

#: The inserted length is for the picture and the score: measured at 60 Hz, for it costs a third of a tick.
_INSERTED_EVERY = 16
# Kinds of contacts on the wire.
TOOL_DUCT, TOOL_CATHETER, CATHETER_DUCT, OTHER = range(4)
# Columns of the table of reactions, a row a tool: nine for three vectors, nine for K, and these.
_GRASP_TORQUE, _GRASP_STIFFNESS, _JAW_ANGLE, _CONTACTS, _HOLDS, _COLUMNS = 18, 19, 20, 21, 22, 23


class Outputs:
    """Publishes the state of one simulation."""

    def __init__(self, simulation: Simulation, basis_hash: str) -> None:
        self._simulation = simulation
        self._basis_hash = basis_hash
        self._inserted_m = 0.0
        self._inserted_is_old = False
        self._kinds = np.zeros(simulation.contacts.capacity, np.int8)
        self._table = np.zeros((N_TOOLS, _COLUMNS))

    def publish(self, bus: Bus, answered: Frame, *, valid: bool) -> None:
        """Send the state, as the answer to one frame of tools: one frame, for each more would wake haptics again."""
        state = self.state(answered.body.tick, answered.body.tools)
        self._inserted_is_old |= state.tick % _INSERTED_EVERY == 0
        bus.publish("physics.state", state, origin_ns=answered.origin_ns, valid=valid and answered.valid)

    def settle(self) -> None:
        """Measure, between two ticks, what is only looked at: the next frames have it."""
        if self._inserted_is_old:
            self._inserted_is_old = False
            self._inserted_m = self._simulation.inserted_length_m

    def state(self, tick: int, tools: tuple[ToolState, ...]) -> PhysicsState:
        """Return all that is known after a step, and what each of `tools`, which it was solved for, feels."""
        contacts = self._contacts()
        return PhysicsState(
            tick=tick,
            tools=tuple(map(_reaction, self._table.tolist(), tools)),
            duct=self._duct(),
            catheter=self._catheter(),
            contacts=contacts,
        )

    def _duct(self) -> Duct:
        s = self._simulation
        return Duct(
            basis_hash=self._basis_hash,
            q=pack(s.duct_state.q),
            q_rate=pack(s.duct_state.qdot),
            load_node=pack(s.load_nodes[: s.n_loads], "<i4"),
            load_force_n=pack(s.load_force_n[: s.n_loads]),
        )

    def _catheter(self) -> Catheter:
        catheter = self._simulation.catheter
        return Catheter(
            position_m=pack(catheter.state.position_m),
            velocity_m_s=pack(catheter.state.velocity_m_s),
            radius_m=catheter.radius_m,
            inserted_length_m=self._inserted_m,
        )

    def _contacts(self) -> ContactForces:
        """Return the solved contacts, with the table of reactions brought up to date."""
        s = self._simulation
        rows, out, forces = s.contacts, s.tool_results, s.contact_force_n
        n = rows.n_contacts
        vectors = out.force_n, out.port_moment_nm, out.proxy_position_m
        scalars = out.grasp_torque_nm, out.grasp_stiffness_nm_rad, out.proxy_jaw_angle_rad
        tabulate(vectors, out.stiffness_n_m, scalars, self._table)
        holds = s.holds.rows
        count(rows.address, (holds.start, holds.stop), forces, self._kinds, self._table)
        return ContactForces(
            kind=pack(self._kinds[:n], "|i1"),
            point_m=pack(rows.point_m[:n]),
            force_n=pack(forces),
            max_penetration_m=s.max_penetration_m,
        )


def _reaction(row: list[float], tool: ToolState) -> ToolReaction:
    """Return a row of the table, and the hand that it was solved for, as it travels."""
    return ToolReaction(
        force_n=cast(Vec3, tuple(row[0:3])),
        port_moment_nm=cast(Vec3, tuple(row[3:6])),
        grasp_torque_nm=row[_GRASP_TORQUE],
        grasp_stiffness_nm_rad=row[_GRASP_STIFFNESS],
        stiffness_n_m=cast(Mat3, tuple(row[9:18])),
        position_m=tool.position_m,
        jaw_angle_rad=tool.jaw_angle_rad,
        proxy_position_m=cast(Vec3, tuple(row[6:9])),
        proxy_jaw_angle_rad=row[_JAW_ANGLE],
        contacts=int(row[_CONTACTS]),
        holds=int(row[_HOLDS]),
    )


@kernel
def tabulate(vectors: Arrays, stiffness: FloatArray, scalars: Arrays, table: FloatArray) -> None:
    """Write what each tool feels into its row."""
    for tool in range(table.shape[0]):
        for axis in range(3):
            for block in range(3):
                table[tool, 3 * block + axis] = vectors[block][tool, axis]
            for other in range(3):
                table[tool, 9 + 3 * axis + other] = stiffness[tool, axis, other]
        table[tool, _GRASP_TORQUE], table[tool, _GRASP_STIFFNESS] = scalars[0][tool], scalars[1][tool]
        table[tool, _JAW_ANGLE] = scalars[2][tool]


@kernel
def count(
    address: Address[ContactRows], holds: tuple[int, int], force: FloatArray, kinds: ByteArray, table: FloatArray
) -> None:
    """Write the kind of each row for the wire, and count each tool's contacts.

    ``holds`` are the first row of a hold and the one after the last.
    """
    rows = rows_at(address)
    tool, duct_weight = rows.tool, rows.duct_weight
    table[:, _CONTACTS:] = 0.0
    for row in range(force.shape[0]):
        on_duct = duct_weight[row, 0] != 0.0 or duct_weight[row, 1] != 0.0 or duct_weight[row, 2] != 0.0
        of_tool = tool[row] != NO_TOOL
        if not of_tool:
            kinds[row] = CATHETER_DUCT if on_duct else OTHER
            continue
        kinds[row] = TOOL_DUCT if on_duct else TOOL_CATHETER
        if holds[0] <= row < holds[1]:
            table[tool[row], _HOLDS] += 1.0
        elif force[row, 0] != 0.0 or force[row, 1] != 0.0 or force[row, 2] != 0.0:
            table[tool[row], _CONTACTS] += 1.0
