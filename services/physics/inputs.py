"""From ``haptics.contacts`` to the arrays of the mechanics: indices are checked here, since kernels trust them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from protocol.bodies import GraspHold as HoldBody
from protocol.bodies import ToolContacts
from services.mechanics.contact.pairs import CATHETER_SEGMENT, ContactPairs
from services.mechanics.simulation import Simulation
from services.mechanics.tools import N_TOOLS, GraspHold, ToolInputs


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
        self._n_targets = np.array([n_triangles, n_segments])

    def take(self, body: ToolContacts) -> bool:
        """Copy `body` into `tools` and `pairs`; False, and nothing copied, if it names something that is not there."""
        kind, target = body.target_kind.view(), body.target.view()
        in_range = (
            _within(body.tool.view(), N_TOOLS)
            and _within(body.tool_segment.view(), 3)
            and _within(kind, 2)
            and bool(((target >= 0) & (target < self._n_targets[kind])).all())
            and all(self._is_there(hold) for hold in body.holds)
        )
        if not in_range:
            self.refused += 1
            return False
        self._take_tools(body)
        self._take_pairs(body)
        return True

    def _is_there(self, hold: HoldBody) -> bool:
        return hold.tool < N_TOOLS and hold.target < self._n_targets[hold.target_kind]

    def _take_tools(self, body: ToolContacts) -> None:
        tools = self.tools
        tools.present[:] = False
        for i, tool in enumerate(body.tools[:N_TOOLS]):
            tools.present[i] = True
            self._port_m[i] = tool.port_m
            tools.position_m[i] = tool.position_m
            tools.velocity_m_s[i] = tool.velocity_m_s
            tools.roll_rad[i] = tool.roll_rad
            tools.jaw_angle_rad[i] = tool.jaw_angle_rad
            tools.jaw_rate_rad_s[i] = tool.jaw_rate_rad_s
        tools.holds = [_hold(hold) for hold in body.holds]

    def _take_pairs(self, body: ToolContacts) -> None:
        pairs = self.pairs
        n = min(len(body.gap_m.view()), pairs.capacity)
        pairs.clear()
        pairs.count = n
        pairs.dropped = len(body.gap_m.view()) - n
        pairs.tool[:n] = body.tool.view()[:n]
        pairs.tool_segment[:n] = body.tool_segment.view()[:n]
        pairs.particle[:n] = -1
        pairs.target_kind[:n] = body.target_kind.view()[:n]
        pairs.target[:n] = body.target.view()[:n]
        pairs.tool_parameter[:n] = body.tool_parameter.view()[:n]
        pairs.target_weights[:n] = body.target_weights.view()[:n]
        pairs.normal[:n] = body.normal.view()[:n]
        pairs.gap_m[:n] = body.gap_m.view()[:n]


def _within(indices: NDArray[np.int8], end: int) -> bool:
    return bool(((indices >= 0) & (indices < end)).all())


def _hold(body: HoldBody) -> GraspHold:
    if body.target_kind == CATHETER_SEGMENT:
        weights = np.array([*body.target_weights[:2], 0.0])
    else:
        weights = np.array(body.target_weights)
    return GraspHold(body.hold_id, body.tool, body.target_kind, body.target, weights, body.limit_n, body.jaw_angle_rad)
