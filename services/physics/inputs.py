"""From ``haptics.contacts`` to the arrays of the mechanics: indices are checked here, since kernels trust them."""

from __future__ import annotations

import numpy as np

from protocol.arrays import pack
from protocol.bodies import GraspHold as HoldBody
from protocol.bodies import ToolContacts
from protocol.bodies.haptics import PAIR_GEOMETRY, PAIR_INDICES
from services.mechanics.arrays import FloatArray, IntArray
from services.mechanics.bodies.forceps.kinematics import N_SEGMENTS
from services.mechanics.collision.pairs import CATHETER_SEGMENT, ContactPairs, pairs_at
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address
from services.mechanics.scene.tools import N_TOOLS, GraspHold, ToolInputs
from services.mechanics.simulation import Simulation

NO_PARTICLE = -1


class ContactsReader:
    """Holds the tools and pairs of the newest accepted frame.

    Attributes
    ----------
    tools, pairs
        What a step takes; overwritten in place by `take`.
    refused
        Frames whose indices point nowhere.
    """

    def __init__(self, simulation: Simulation) -> None:
        self.tools = ToolInputs()
        self.pairs = ContactPairs.allocate(simulation.scene.contact.capacity)
        self.refused = 0
        self._port_m = simulation.tools.port_m
        n_triangles = simulation.duct.reduced.mesh.triangles.shape[0]
        n_segments = simulation.catheter.state.position_m.shape[0] - 1
        self._n_targets = np.array([n_triangles, n_segments], np.int32)

    def take(self, body: ToolContacts) -> bool:
        """Copy `body` into `tools` and `pairs`; False, and nothing copied, if it names something that is not there."""
        index, geometry = body.pair_index.view(), body.pair_geometry.view()
        holds_there = all(self._is_there(hold) for hold in body.holds)
        if not (holds_there and take_pairs(index, geometry, self._n_targets, self.pairs.address)):
            self.refused += 1
            return False
        self._take_tools(body)
        return True

    def compile_kernels(self) -> None:
        """Read an empty frame as it comes off the wire."""
        index, geometry = pack(np.zeros((0, PAIR_INDICES)), "<i4"), pack(np.zeros((0, PAIR_GEOMETRY)))
        self.take(ToolContacts(tick=0, tools=(), pair_index=index, pair_geometry=geometry))

    def _is_there(self, hold: HoldBody) -> bool:
        return hold.tool < N_TOOLS and hold.target < int(self._n_targets[hold.target_kind])

    def _take_tools(self, body: ToolContacts) -> None:
        tools = self.tools
        tools.present[:] = False
        for i, tool in enumerate(body.tools[:N_TOOLS]):
            tools.present[i] = True
            self._port_m[i] = tool.port_m
            tools.position_m[i] = tool.position_m
            tools.roll_rad[i] = tool.roll_rad
            tools.jaw_angle_rad[i] = tool.jaw_angle_rad
        tools.holds = [_hold(hold) for hold in body.holds]


@kernel
def take_pairs(index: IntArray, geometry: FloatArray, n_targets: IntArray, address: Address[ContactPairs]) -> bool:
    """Copy tables of the wire into the pairs; False, and nothing copied, if a row names what is not there.

    ``n_targets`` (2,) are the numbers of triangles and of segments. Rows beyond the pairs' capacity are dropped.
    """
    n_sent = index.shape[0]
    for row in range(n_sent):
        tool, segment, kind, target = index[row, 0], index[row, 1], index[row, 2], index[row, 3]
        named = 0 <= tool < N_TOOLS and 0 <= segment < N_SEGMENTS and 0 <= kind < n_targets.shape[0]
        if not (named and 0 <= target < n_targets[kind]):
            return False
    pairs = pairs_at(address)
    pairs.count = min(n_sent, pairs.gap_m.shape[0])
    pairs.dropped = n_sent - pairs.count
    for row in range(pairs.count):
        pairs.particle[row] = NO_PARTICLE
        pairs.tool[row], pairs.tool_segment[row] = index[row, 0], index[row, 1]
        pairs.target_kind[row], pairs.target[row] = index[row, 2], index[row, 3]
        pairs.tool_parameter[row], pairs.gap_m[row] = geometry[row, 0], geometry[row, 7]
        for axis in range(3):
            pairs.target_weights[row, axis] = geometry[row, 1 + axis]
            pairs.normal[row, axis] = geometry[row, 4 + axis]
    return True


def _hold(body: HoldBody) -> GraspHold:
    if body.target_kind == CATHETER_SEGMENT:
        weights = np.array([*body.target_weights[:2], 0.0])
    else:
        weights = np.array(body.target_weights)
    return GraspHold(body.hold_id, body.tool, body.target_kind, body.target, weights, body.limit_n, body.jaw_angle_rad)
