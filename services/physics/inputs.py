"""From ``haptics.contacts`` to the arrays of the mechanics: indices are checked here, since kernels trust them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from protocol.arrays import pack
from protocol.bodies import GraspHold as HoldBody
from protocol.bodies import ToolContacts
from services.mechanics.arrays import IntArray
from services.mechanics.bodies.forceps.kinematics import N_SEGMENTS
from services.mechanics.collision.pairs import CATHETER_SEGMENT, TOOL_COLUMNS, ContactPairs
from services.mechanics.compiled import kernel
from services.mechanics.scene.tools import N_TOOLS, GraspHold, ToolInputs
from services.mechanics.simulation import Simulation

Column = NDArray[Any]


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
        columns = {name: getattr(body, name).view() for name in TOOL_COLUMNS}
        indices = columns["tool"], columns["tool_segment"], columns["target_kind"], columns["target"]
        if not (all(self._is_there(hold) for hold in body.holds) and indices_are_there(indices, self._n_targets)):
            self.refused += 1
            return False
        self._take_tools(body)
        self._take_pairs(columns)
        return True

    def _take_pairs(self, columns: dict[str, Column]) -> None:
        pairs, n_sent = self.pairs, len(columns["tool"])
        pairs.count = n = min(n_sent, pairs.capacity)
        pairs.dropped = n_sent - n
        pairs.particle[:n] = -1
        for name, column in columns.items():
            getattr(pairs, name)[:n] = column[:n]

    def compile_kernels(self) -> None:
        """Read an empty frame as it comes off the wire."""
        bytes_, floats = pack([], "|i1"), pack([])
        rows = pack(np.zeros((0, 3)))
        self.take(
            ToolContacts(
                tick=0, tools=(), tool=bytes_, tool_segment=bytes_, target_kind=bytes_, target=pack([], "<i4"),
                tool_parameter=floats, target_weights=rows, normal=rows, gap_m=floats,
            )
        )  # fmt: skip

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
def indices_are_there(indices: tuple[Column, ...], n_targets: IntArray) -> bool:
    """Return whether tools, segments, kinds and targets of all pairs exist."""
    tool, segment, kind, target = indices
    for row in range(tool.shape[0]):
        named = 0 <= tool[row] < N_TOOLS and 0 <= segment[row] < N_SEGMENTS and 0 <= kind[row] < n_targets.shape[0]
        if not (named and 0 <= target[row] < n_targets[kind[row]]):
            return False
    return True


def _hold(body: HoldBody) -> GraspHold:
    if body.target_kind == CATHETER_SEGMENT:
        weights = np.array([*body.target_weights[:2], 0.0])
    else:
        weights = np.array(body.target_weights)
    return GraspHold(body.hold_id, body.tool, body.target_kind, body.target, weights, body.limit_n, body.jaw_angle_rad)
