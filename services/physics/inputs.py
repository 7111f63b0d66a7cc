"""From ``haptics.contacts`` to the arrays of the mechanics: indices are checked here, since kernels trust them."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from protocol.arrays import pack
from protocol.bodies import GraspHold as HoldBody
from protocol.bodies import ToolContacts
from protocol.bodies.haptics import (
    PAIR_GAP,
    PAIR_GEOMETRY,
    PAIR_INDICES,
    PAIR_KIND,
    PAIR_NORMAL,
    PAIR_PARAMETER,
    PAIR_SEGMENT,
    PAIR_TARGET,
    PAIR_TOOL,
    PAIR_WEIGHTS,
    TOOL_COLUMNS,
    TOOL_OPENING,
    TOOL_PORT,
    TOOL_POSITION,
    TOOL_ROLL,
    tool_table,
)
from protocol.vectors import Vec3
from services.mechanics.arrays import BoolArray, FloatArray, IntArray
from services.mechanics.collision.pair_faults import names_fault, numbers_fault
from services.mechanics.collision.pairs import CATHETER_SEGMENT, DUCT_TRIANGLE, ContactPairs, pairs_at
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address, Struct, reader
from services.mechanics.compiled.vectors import put_row
from services.mechanics.scene.tools import N_TOOLS, GraspHold, ToolInputs
from services.mechanics.simulation import Simulation
from services.runtime.flat_view import flat_view

NO_PARTICLE = -1
# Rows of a frame that are looked at, over the pairs that there is room for.
_ROOM = 4
_ROW_BYTES = 4 * PAIR_INDICES, 8 * PAIR_GEOMETRY
_TOOL_BYTES = 8 * TOOL_COLUMNS


class Tables(Struct):
    """The tables of a frame as they travel, and where what they say of the tools goes."""

    index: Annotated[IntArray, "rows", PAIR_INDICES]
    geometry: Annotated[FloatArray, "rows", PAIR_GEOMETRY]
    n_targets: Annotated[IntArray, 2]  # triangles and segments
    tools: Annotated[FloatArray, N_TOOLS, TOOL_COLUMNS]
    present: Annotated[BoolArray, N_TOOLS]
    port: Annotated[FloatArray, N_TOOLS, 3]
    position: Annotated[FloatArray, N_TOOLS, 3]
    roll: Annotated[FloatArray, N_TOOLS]
    opening: Annotated[FloatArray, N_TOOLS]


tables_at = reader(Tables)


class ContactsReader:
    """Holds the tools and pairs of the newest accepted frame.

    Attributes
    ----------
    tools, pairs
        What a step takes; overwritten in place by `take`.
    refused
        Frames whose indices point nowhere.
    refused_pairs
        Pairs of other frames whose numbers are none of a contact's: they are left out.
    """

    def __init__(self, simulation: Simulation) -> None:
        self.tools = ToolInputs()
        self.pairs = ContactPairs.allocate(simulation.scene.contact.capacity)
        self.refused = 0
        self.refused_pairs = 0
        n_triangles = simulation.duct.reduced.mesh.triangles.shape[0]
        n_segments = simulation.catheter.state.position_m.shape[0] - 1
        self._room = _ROOM * self.pairs.capacity
        self._most = {DUCT_TRIANGLE: n_triangles, CATHETER_SEGMENT: n_segments}
        self._weights: dict[int, tuple[Vec3, FloatArray]] = {}
        tables = self._tables = Tables.zeros(
            rows=self._room,
            n_targets=np.array([n_triangles, n_segments], np.int32),
            present=self.tools.present,
            port=simulation.tools.port_m,
            position=self.tools.position_m,
            roll=self.tools.roll_rad,
            opening=self.tools.jaw_angle_rad,
        )
        self._bytes = tuple(flat_view(table).cast("B") for table in (tables.index, tables.geometry, tables.tools))

    def take(self, body: ToolContacts) -> bool:
        """Copy `body` into `tools` and `pairs`; False, and nothing copied, if it names something that is not there."""
        holds_there = not body.holds or all(map(self._is_there, body.holds))
        if not (holds_there and self._take_tables(body)):
            self.refused += 1
            return False
        self._take_holds(body.holds)
        return True

    def _take_tables(self, body: ToolContacts) -> bool:
        """Copy the tables' bytes to where numpy knows them: to make arrays of them would take four times as long."""
        index, geometry, tools = body.pair_index.data, body.pair_geometry.data, body.tools.data
        n_pairs, n_tools = len(index) // _ROW_BYTES[0], len(tools) // _TOOL_BYTES
        if n_pairs > self._room:
            index, geometry = index[: self._room * _ROW_BYTES[0]], geometry[: self._room * _ROW_BYTES[1]]
        if n_tools > N_TOOLS:
            n_tools, tools = N_TOOLS, tools[: N_TOOLS * _TOOL_BYTES]
        indices, numbers, hands = self._bytes
        indices[: len(index)] = index
        numbers[: len(geometry)] = geometry
        hands[: len(tools)] = tools
        left_out: int = take_tables(self._tables.address, n_pairs, n_tools, self.pairs.address)
        self.refused_pairs += max(left_out, 0)
        return left_out >= 0

    def compile_kernels(self) -> None:
        """Read an empty frame as it comes off the wire."""
        index, geometry = pack(np.zeros((0, PAIR_INDICES)), "<i4"), pack(np.zeros((0, PAIR_GEOMETRY)))
        self.take(ToolContacts(tick=0, tools=tool_table(()), pair_index=index, pair_geometry=geometry))

    def _is_there(self, hold: HoldBody) -> bool:
        return hold.tool < N_TOOLS and hold.target < self._most[hold.target_kind]

    def _take_holds(self, holds: tuple[HoldBody, ...]) -> None:
        self.tools.holds = [self._hold(hold) for hold in holds] if holds else []
        if len(self._weights) > len(holds):
            self._weights = {hold.hold_id: self._weights[hold.hold_id] for hold in holds}

    def _hold(self, body: HoldBody) -> GraspHold:
        known = self._weights.get(body.hold_id)
        if known is None or known[0] != body.target_weights:
            known = self._weights[body.hold_id] = body.target_weights, _weights(body)
        return GraspHold(
            body.hold_id, body.tool, body.target_kind, body.target, known[1], body.limit_n, body.jaw_angle_rad
        )


@kernel
def take_tables(tables_address: Address[Tables], n_sent: int, n_tools: int, address: Address[ContactPairs]) -> int:
    """Copy the first rows of tables of the wire into the pairs, and ``n_tools`` tools; return how many pairs were left
    out as no contacts.

    -1, and none copied, if one names what is not there. Rows beyond the pairs' capacity are dropped.
    """
    tables = tables_at(tables_address)
    index = tables.index
    for row in range(min(n_sent, index.shape[0])):
        tool, segment, kind = index[row, PAIR_TOOL], index[row, PAIR_SEGMENT], index[row, PAIR_KIND]
        if names_fault(tool, segment, kind, index[row, PAIR_TARGET], tables.n_targets):
            return -1
    _take_tools(tables, n_tools)
    return int(_take_pairs(tables, n_sent, pairs_at(address)))


@kernel
def _take_tools(tables: Tables, n_tools: int) -> None:
    """Copy the rows of the tools that are there; of one that is not, what was known stays."""
    rows = tables.tools
    for tool in range(rows.shape[0]):
        tables.present[tool] = tool < n_tools
        if tool < n_tools:
            for axis in range(3):
                tables.position[tool, axis] = rows[tool, TOOL_POSITION + axis]
                tables.port[tool, axis] = rows[tool, TOOL_PORT + axis]
            tables.roll[tool], tables.opening[tool] = rows[tool, TOOL_ROLL], rows[tool, TOOL_OPENING]


@kernel
def _take_pairs(tables: Tables, n_sent: int, pairs: ContactPairs) -> int:
    """Copy rows of pairs; return how many of those that were looked at are left out."""
    index, geometry = tables.index, tables.geometry
    n_looked_at, n = min(n_sent, pairs.gap_m.shape[0]), 0
    for row in range(n_looked_at):
        w, d = PAIR_WEIGHTS, PAIR_NORMAL
        weights = geometry[row, w], geometry[row, w + 1], geometry[row, w + 2]
        normal = geometry[row, d], geometry[row, d + 1], geometry[row, d + 2]
        parameter, gap = geometry[row, PAIR_PARAMETER], geometry[row, PAIR_GAP]
        if numbers_fault(parameter, weights, normal, gap):
            continue
        pairs.particle[n] = NO_PARTICLE
        pairs.tool[n], pairs.tool_segment[n] = index[row, PAIR_TOOL], index[row, PAIR_SEGMENT]
        pairs.target_kind[n], pairs.target[n] = index[row, PAIR_KIND], index[row, PAIR_TARGET]
        pairs.tool_parameter[n], pairs.gap_m[n] = parameter, gap
        put_row(pairs.target_weights, n, weights)
        put_row(pairs.normal, n, normal)
        n += 1
    pairs.count = n
    pairs.dropped = n_sent - n_looked_at
    return int(n_looked_at - n)


def _weights(body: HoldBody) -> FloatArray:
    if body.target_kind == CATHETER_SEGMENT:
        return np.array([*body.target_weights[:2], 0.0])
    return np.array(body.target_weights)
