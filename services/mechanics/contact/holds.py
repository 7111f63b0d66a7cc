"""Grasps as bilateral rows: a point of the jaws and a point of the catheter or the wall move together."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from services.mechanics.contact.geometry import write_frame
from services.mechanics.contact.pairs import CATHETER_SEGMENT, JAW_A, NO_TOOL
from services.mechanics.contact.rows import GRIP_SOFTNESS_M_N, LOOSE_SOFTNESS_M_N
from services.mechanics.contact.solver import HOLD, ON_THE_LIMIT
from services.mechanics.contact.system import ContactSystem
from services.mechanics.forceps.kinematics import contact_lever
from services.mechanics.forceps.tool_body import ToolBody
from services.mechanics.scene import ForcepsScene
from services.mechanics.tools import GraspHold

FloatArray = npt.NDArray[np.float64]


@dataclass(slots=True)
class ActiveHold:
    """A hold with the place of its point in the jaws, which moves only when it slips."""

    request: GraspHold
    anchor: FloatArray
    """(3,) coordinates along b, h and d of the tool from J, in m."""
    target: int
    weights: FloatArray
    slipped_m: float = 0.0
    lost: bool = False


class HoldRegistry:
    """The holds of both tools: follows the requests, fills rows, and lets slipping holds slide.

    A hold on the catheter slides along it first, so that a forceps that slips ends up further along the
    catheter; what is left of the slip moves the point in the jaws. A point that leaves the jaws, or the
    catheter's end, is lost.
    """

    def __init__(self, forceps: tuple[ForcepsScene, ...], system: ContactSystem) -> None:
        self._forceps = forceps
        self._system = system
        self.active: dict[int, ActiveHold] = {}
        self.dissipated_j = 0.0
        self._lost: set[int] = set()

    def follow(self, requests: list[GraspHold]) -> None:
        """Take up new requests, update limits, drop what is no longer asked for."""
        if not requests and not self.active:
            return
        asked = {request.hold_id for request in requests}
        for gone in [hold_id for hold_id in self.active if hold_id not in asked]:
            del self.active[gone]
        self._lost &= asked
        for request in requests:
            if request.hold_id in self.active:
                self.active[request.hold_id].request = request
            elif request.hold_id not in self._lost:
                self.active[request.hold_id] = self._take_up(request)

    def tell(self, tools: ToolBody) -> None:
        """Tell the tools what they hold and where that stops their jaws."""
        tools.held[:] = False
        tools.jaw_stop_rad[:] = -math.inf
        for hold in self.active.values():
            tool = hold.request.tool
            tools.held[tool, hold.request.target_kind] = True
            tools.jaw_stop_rad[tool] = max(tools.jaw_stop_rad[tool], hold.request.jaw_angle_rad)

    def append_rows(self) -> None:
        """Append one bilateral row block per hold."""
        axial: set[int] = set()
        for hold in self.active.values():
            if self._system.rows.n_contacts == self._system.rows.capacity:
                return
            row = self._tool_side(hold)
            if hold.request.target_kind == CATHETER_SEGMENT:
                self._catheter_side(hold, row)
                self._share_axially(row, hold, axial)
            else:
                self._duct_side(hold, row)

    def slide(self) -> None:
        """Let the holds that are at their limit take the motion that the solve left them."""
        if not self.active:
            return
        rows, motion = self._system.rows, self._system.motion_m
        first = rows.n_contacts - len(self.active)
        for row, hold in enumerate(list(self.active.values()), start=first):
            if float(np.linalg.norm(rows.force_n[row])) < ON_THE_LIMIT * float(rows.limit[row]):
                continue
            in_frame = motion[3 * row : 3 * row + 3]
            self.dissipated_j -= float(rows.force_n[row] @ in_frame)
            slip = in_frame @ rows.frame[row]
            hold.slipped_m += float(np.linalg.norm(slip))
            self._slide_one(hold, slip)
            if hold.lost:
                del self.active[hold.request.hold_id]
                self._lost.add(hold.request.hold_id)

    def _take_up(self, request: GraspHold) -> ActiveHold:
        tools = self._system.tool_geometry
        if request.target_kind == CATHETER_SEGMENT:
            position = self._system.rod_geometry.position
            point = request.target_weights[:2] @ position[request.target : request.target + 2]
        else:
            point = self._system.bodies.duct.point_at_start(request.target, request.target_weights)
        anchor: FloatArray = tools.frame[request.tool] @ (point - tools.segments[request.tool, JAW_A, 0])
        return ActiveHold(request, anchor, request.target, request.target_weights.copy())

    def _tool_side(self, hold: ActiveHold) -> int:
        rows, tools, tool = self._system.rows, self._system.tool_geometry, hold.request.tool
        row = rows.n_contacts
        arm = hold.anchor @ tools.frame[tool]
        rows.kind[row] = HOLD
        rows.identity[row] = rows.body[row] = -1 - hold.request.hold_id
        rows.frame[row] = np.eye(3)
        rows.limit[row] = math.inf
        rows.softness_m_n[row] = GRIP_SOFTNESS_M_N
        rows.sphere[row] = -1
        rows.gap_m[row] = 0.0
        rows.duct_weight[row] = 0.0
        rows.rod_weight[row] = 0.0
        rows.tool[row] = tool
        # The held point sits between both jaws: opening or closing them does not move it.
        contact_lever(tools.frame[tool], tools.length[tool], NO_TOOL, arm, rows.lever[row])
        rows.point_m[row] = tools.segments[tool, JAW_A, 0] + arm
        rows.slip_m[row] = rows.point_m[row] + rows.lever[row] @ tools.motion[tool]
        rows.used[0] = row + 1
        return row

    def _catheter_side(self, hold: ActiveHold, row: int) -> None:
        rows, rod = self._system.rows, self._system.rod_geometry
        for end in range(2):
            node, weight = hold.target + end, hold.weights[end]
            rows.rod_node[row, 2 + end] = node
            rows.rod_weight[row, 2 + end] = -weight
            rows.slip_m[row] -= weight * (rod.position[node] + rod.motion[node])

    def _share_axially(self, row: int, hold: ActiveHold, axial: set[int]) -> None:
        """Turn the frame along the catheter; only the first hold of each tool is stiff in that direction.

        Two stiff points a millimetre apart on a rod that hardly stretches would fight over micrometres.
        """
        rows, position = self._system.rows, self._system.rod_geometry.position
        edge = position[hold.target + 1] - position[hold.target]
        write_frame(edge / np.linalg.norm(edge), rows.frame[row])
        if hold.request.tool in axial:
            rows.softness_m_n[row, 0] = LOOSE_SOFTNESS_M_N
        axial.add(hold.request.tool)

    def _duct_side(self, hold: ActiveHold, row: int) -> None:
        """Take the rest position off; the displacement goes with that of all other contacts."""
        rows, duct = self._system.rows, self._system.duct_geometry
        nodes = duct.triangles[hold.target]
        rows.duct_node[row] = nodes
        rows.duct_weight[row] = hold.weights
        rows.slip_m[row] -= hold.weights @ duct.vertices[nodes]

    def _slide_one(self, hold: ActiveHold, slip: FloatArray) -> None:
        rest = slip
        if hold.request.target_kind == CATHETER_SEGMENT:
            rest = slip - _slide_along(hold, slip, self._system.rod_geometry.position)
        hold.anchor -= self._system.tool_geometry.frame[hold.request.tool] @ rest
        forceps = self._forceps[hold.request.tool]
        width = 3.0 * forceps.jaw_radius_m
        b, h, d = hold.anchor
        in_jaws = -width <= d <= forceps.jaw_length_m + width and abs(b) <= width and abs(h) <= width
        hold.lost |= not in_jaws


def _slide_along(hold: ActiveHold, slip: FloatArray, position: FloatArray) -> FloatArray:
    """Move the held point along the catheter by the axial part of ``slip`` and return that part."""
    edge = position[hold.target + 1] - position[hold.target]
    length = float(np.linalg.norm(edge))
    tangent = edge / length
    axial = float(slip @ tangent)
    at = hold.target + float(hold.weights[1]) + axial / length
    n_segments = position.shape[0] - 1
    hold.lost |= not 0.0 <= at <= n_segments
    at = min(max(at, 0.0), float(n_segments))
    hold.target = min(int(at), n_segments - 1)
    s = at - hold.target
    hold.weights[:] = (1.0 - s, s, 0.0)
    along: FloatArray = axial * tangent
    return along
