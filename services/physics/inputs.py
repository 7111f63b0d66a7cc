"""From ``haptics.contacts`` to the arrays of the mechanics: indices are checked here, since kernels trust them."""

from __future__ import annotations

import numpy as np

from protocol.arrays import pack
from protocol.bodies import GraspHold as HoldBody
from protocol.bodies import ToolContacts
from protocol.bodies.haptics import PAIR_GEOMETRY, PAIR_INDICES
from protocol.vectors import Vec3
from services.mechanics.arrays import FloatArray, IntArray
from services.mechanics.collision.pair_faults import names_fault, numbers_fault
from services.mechanics.collision.pairs import CATHETER_SEGMENT, DUCT_TRIANGLE, ContactPairs, pairs_at
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address
from services.mechanics.compiled.vectors import put_row
from services.mechanics.scene.tools import N_TOOLS, GraspHold, ToolInputs
from services.mechanics.simulation import Simulation
from services.runtime.flat_view import flat_view

NO_PARTICLE = -1
# Rows of a frame that are looked at, over the pairs that there is room for.
_ROOM = 4
_ROW_BYTES = 4 * PAIR_INDICES, 8 * PAIR_GEOMETRY


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
        room = _ROOM * self.pairs.capacity
        self._index, self._geometry = np.zeros((room, PAIR_INDICES), np.int32), np.zeros((room, PAIR_GEOMETRY))
        self._bytes = flat_view(self._index).cast("B"), flat_view(self._geometry).cast("B")
        self._weights: dict[int, tuple[Vec3, FloatArray]] = {}
        self._n_targets = np.array([n_triangles, n_segments], np.int32)
        self._most = {DUCT_TRIANGLE: n_triangles, CATHETER_SEGMENT: n_segments}
        tools = self.tools
        arrays = tools.present, simulation.tools.port_m, tools.position_m, tools.roll_rad, tools.jaw_angle_rad
        # Numbers are put into a memory view three at a time for what numpy takes to look at a tuple.
        self._views = tuple(map(flat_view, arrays))

    def take(self, body: ToolContacts) -> bool:
        """Copy `body` into `tools` and `pairs`; False, and nothing copied, if it names something that is not there."""
        holds_there = not body.holds or all(map(self._is_there, body.holds))
        if not (holds_there and self._take_pairs(body.pair_index.data, body.pair_geometry.data)):
            self.refused += 1
            return False
        self._take_tools(body)
        return True

    def _take_pairs(self, index: bytes, geometry: bytes) -> bool:
        """Copy the tables' bytes to where numpy knows them: to make arrays of them would take four times as long."""
        n_sent, room = len(index) // _ROW_BYTES[0], len(self._index)
        if n_sent > room:
            index, geometry = index[: room * _ROW_BYTES[0]], geometry[: room * _ROW_BYTES[1]]
        indices, numbers = self._bytes
        indices[: len(index)] = index
        numbers[: len(geometry)] = geometry
        left_out = take_pairs(self._index, self._geometry, n_sent, self._n_targets, self.pairs.address)
        self.refused_pairs += max(left_out, 0)
        return bool(left_out >= 0)

    def compile_kernels(self) -> None:
        """Read an empty frame as it comes off the wire."""
        index, geometry = pack(np.zeros((0, PAIR_INDICES)), "<i4"), pack(np.zeros((0, PAIR_GEOMETRY)))
        self.take(ToolContacts(tick=0, tools=(), pair_index=index, pair_geometry=geometry))

    def _is_there(self, hold: HoldBody) -> bool:
        return hold.tool < N_TOOLS and hold.target < self._most[hold.target_kind]

    def _take_tools(self, body: ToolContacts) -> None:
        present, port, position, roll, jaw = self._views
        n_sent = len(body.tools)
        for i in range(N_TOOLS):
            present[i] = i < n_sent
            if i < n_sent:
                tool = body.tools[i]
                port[3 * i], port[3 * i + 1], port[3 * i + 2] = tool.port_m
                position[3 * i], position[3 * i + 1], position[3 * i + 2] = tool.position_m
                roll[i], jaw[i] = tool.roll_rad, tool.jaw_angle_rad
        self.tools.holds = [self._hold(hold) for hold in body.holds] if body.holds else []
        if len(self._weights) > len(body.holds):
            self._weights = {hold.hold_id: self._weights[hold.hold_id] for hold in body.holds}

    def _hold(self, body: HoldBody) -> GraspHold:
        known = self._weights.get(body.hold_id)
        if known is None or known[0] != body.target_weights:
            known = self._weights[body.hold_id] = body.target_weights, _weights(body)
        return GraspHold(
            body.hold_id, body.tool, body.target_kind, body.target, known[1], body.limit_n, body.jaw_angle_rad
        )


@kernel
def take_pairs(
    index: IntArray, geometry: FloatArray, n_sent: int, n_targets: IntArray, address: Address[ContactPairs]
) -> int:
    """Copy the first rows of tables of the wire into the pairs; return how many were left out as no contacts.

    -1, and none copied, if one names what is not there. ``n_targets`` (2,) are the numbers of triangles and of
    segments. Rows beyond the pairs' capacity are dropped.
    """
    for row in range(min(n_sent, index.shape[0])):
        if names_fault(index[row, 0], index[row, 1], index[row, 2], index[row, 3], n_targets):
            return -1
    pairs = pairs_at(address)
    n_looked_at, n = min(n_sent, pairs.gap_m.shape[0]), 0
    for row in range(n_looked_at):
        weights = geometry[row, 1], geometry[row, 2], geometry[row, 3]
        normal = geometry[row, 4], geometry[row, 5], geometry[row, 6]
        if numbers_fault(geometry[row, 0], weights, normal, geometry[row, 7]):
            continue
        pairs.particle[n] = NO_PARTICLE
        pairs.tool[n], pairs.tool_segment[n] = index[row, 0], index[row, 1]
        pairs.target_kind[n], pairs.target[n] = index[row, 2], index[row, 3]
        pairs.tool_parameter[n], pairs.gap_m[n] = geometry[row, 0], geometry[row, 7]
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
