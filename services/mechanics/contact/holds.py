"""Grasps as bilateral constraints: a point of the jaws and a point of the catheter or the wall move together."""

from __future__ import annotations

import math

import numpy as np

from trocar.services.mechanics.arrays import AnyArray, FloatArray
from trocar.services.mechanics.bodies.forceps.tool_body import ToolBody
from trocar.services.mechanics.collision.pairs import CATHETER_SEGMENT, DUCT_TRIANGLE, JAW_A
from trocar.services.mechanics.contact.hold_rows import HoldArrays, append_holds, slide_holds
from trocar.services.mechanics.contact.system import ContactSystem
from trocar.services.mechanics.rod.curve import point_on_curve
from trocar.services.mechanics.scene import ToolScene
from trocar.services.mechanics.scene.tools import GraspHold

# Tolerance of barycentric weights from another process, which may have rounded them.
WEIGHT_TOLERANCE = 1e-3
# Maximum number of holds. A grasp holds two points; only a faulty process requests more.
CAPACITY = 16


class HoldRegistry:
    """The holds of both tools: begins and ends them as requested, fills their rows, and slides those that slip.

    The slip of a hold on the catheter moves its point along the catheter first, so that slipping jaws end up further
    along it; the rest of the slip moves the point in the jaws. A point that leaves the jaws or the end of the catheter
    is lost. At most `CAPACITY` holds are active; further requests are dropped.

    Attributes:
        active: dict of int to GraspHold. The newest request for each hold by its number, in the order of their rows.
        arrays: HoldArrays. What the active holds hold, and where, in the same order.
        rows: range. Rows of the holds in this step; fewer than active holds if the rows' capacity was exceeded.
        dropped: int. Requests beyond `CAPACITY` since the start, each counted in every step.
        refused: int. Requests since the start that name a target or jaws that do not exist, or contain a NaN; each
            counted in every step.
        dissipated_j: float. Energy that slipping has dissipated since the start.
        lost: set of int. Numbers of holds that were lost and are still requested.
        has_begun: bool. Whether a hold began in this step.
    """

    def __init__(self, forceps: tuple[ToolScene, ...], system: ContactSystem) -> None:
        self._system = system
        self.active: dict[int, GraspHold] = {}
        self.arrays = HoldArrays.zeros(h=CAPACITY)
        self.rows = range(0)
        self.dropped = 0
        self.refused = 0
        self.dissipated_j = 0.0
        self.has_begun = False
        self.lost: set[int] = set()
        self._stops: list[tuple[int, int, float, bool]] = []
        self.save_start()
        geometry = system.geometry
        self._n_targets = len(geometry.wall.triangles), len(geometry.rod.position) - 1  # of each kind
        self._can_hold = [each.jaws is not None or each.drives_catheter for each in forceps]

    def follow(self, requests: list[GraspHold]) -> None:
        """Begin newly requested holds, update limits, and drop holds without a request or whose tool is absent."""
        self.has_begun = False
        if not self._are_active(requests):
            self._follow(requests)
        self._system.rows.reserved = len(self.active)

    def _are_active(self, requests: list[GraspHold]) -> bool:
        """Return whether exactly these holds are active, can bear force, and none is lost: then nothing changes."""
        if self.lost or len(requests) != len(self.active):
            return False
        present = self._system.geometry.tools.present.tolist()
        for each, known in zip(requests, self.active.values(), strict=True):
            if each is not known or not each.limit_n > 0.0 or not present[each.tool]:
                return False
        return True

    def _follow(self, requests: list[GraspHold]) -> None:
        present = self._system.geometry.tools.present.tolist()
        requests = [request for request in requests if self._is_valid(request) and present[request.tool]]
        requested = {request.hold_id for request in requests}
        if requested != self.active.keys():
            for ended in [hold_id for hold_id in self.active if hold_id not in requested]:
                self._drop(ended)
        self.lost &= requested
        for request in requests:
            if request.hold_id in self.active:
                self.active[request.hold_id] = request
            elif request.hold_id not in self.lost:
                self._begin(request)
        self._release_jaws()

    def step_arrays(self) -> tuple[AnyArray, ...]:
        """Return the live arrays that a step changes."""
        return self.arrays.own_memory()

    def save_start(self) -> None:
        """Save the state at the start of a step that is not in `step_arrays`."""
        self._saved = dict(self.active), set(self.lost), self._stops, self.rows

    def restore_start(self) -> None:
        """Restore the saved state; holds that are still active keep their newest request."""
        active, lost, self._stops, self.rows = self._saved
        self.active = {hold_id: self.active.get(hold_id, request) for hold_id, request in active.items()}
        self.lost.intersection_update(lost)
        self.lost.update(lost)

    def release_all(self) -> None:
        """End all holds as lost; requests for the same holds are ignored from then on."""
        self.lost.update(self.active)
        self.active.clear()
        self.rows = range(0)

    def write_jaw_stops(self, tools: ToolBody) -> None:
        """Write into the tools which kinds of target they hold, and the opening below which a held catheter resists."""
        requests = self.active.values()
        stops = [(each.tool, each.target_kind, each.jaw_angle_rad, _replaces_contacts(each)) for each in requests]
        if stops == self._stops:
            return
        self._stops = stops
        tools.held[:] = False
        tools.jaw_stop_rad[:] = -math.inf
        for slot, (tool, target_kind, jaw_angle_rad, replaces_contacts) in enumerate(stops):
            tools.held[tool, target_kind] |= replaces_contacts
            if target_kind == CATHETER_SEGMENT:
                # If the jaws have closed further in the tick of the grasp, the held body does not open them again.
                stop_rad = min(jaw_angle_rad, float(tools.proxy[tool, 3]))
                tools.jaw_stop_rad[tool] = max(tools.jaw_stop_rad[tool], stop_rad)
                tools.stop_arm_m[tool] = max(float(self.arrays.anchor[slot, 2]), float(tools.radius_m[tool, JAW_A]))

    def _release_jaws(self) -> None:
        """Let jaws collide again with a body whose hold has ended: it may spring back against them in this step."""
        held_now = {(each.tool, each.target_kind) for each in self.active.values() if _replaces_contacts(each)}
        for tool, kind, _, replaced_contacts in self._stops:
            if replaced_contacts and (tool, kind) not in held_now:
                self._system.geometry.tools.held[tool, kind] = False

    def append_rows(self) -> None:
        """Append a bilateral row for each hold, up to the rows' capacity."""
        first = self._system.rows.n_contacts
        n_rows = append_holds(self._system.address, self.arrays.address, len(self.active)) if self.active else 0
        self.rows = range(first, first + n_rows)

    def limit_rows(self) -> None:
        """Set the force limit of each hold's row to that of its request."""
        for row, request in zip(self.rows, self.active.values(), strict=False):
            self._system.rows.force_limit_n[row] = request.limit_n

    def slide(self, share: float) -> None:
        """Slide the holds at their limit by the share of the solved slip that has happened, and end those lost."""
        if not self.rows:
            return
        span = self.rows.start, len(self.rows)
        dissipated_j, is_lost = slide_holds(self._system.address, self.arrays.address, span, share)
        self.dissipated_j += dissipated_j
        if is_lost:
            for hold_id in [hold_id for hold_id, lost in zip(self.active, self.arrays.lost, strict=False) if lost]:
                self._drop(hold_id)
                self.lost.add(hold_id)

    def _begin(self, request: GraspHold) -> None:
        if len(self.active) == CAPACITY:
            self.dropped += 1
            return
        arrays, slot, tools = self.arrays, len(self.active), self._system.geometry.tools
        from_junction = self._held_point(request) - tools.segments[request.tool, JAW_A, 0]
        arrays.anchor[slot] = tools.frame[request.tool] @ from_junction
        arrays.number[slot], arrays.tool[slot] = request.hold_id, request.tool
        arrays.target_kind[slot], arrays.target[slot] = request.target_kind, request.target
        arrays.weights[slot] = request.target_weights
        arrays.slipped_m[slot], arrays.lost[slot] = 0.0, False
        self.active[request.hold_id] = request
        self.has_begun = True

    def _is_valid(self, request: GraspHold) -> bool:
        """Return whether a request is valid, and count it if not."""
        is_valid = (
            0 <= request.tool < len(self._can_hold)
            and self._can_hold[request.tool]
            and request.target_kind in (DUCT_TRIANGLE, CATHETER_SEGMENT)
            and 0 <= request.target < self._n_targets[request.target_kind]
            and math.isfinite(request.jaw_angle_rad)
            and request.limit_n >= 0.0
            and _are_weights(*request.target_weights.tolist())
        )
        self.refused += not is_valid
        return is_valid

    def _held_point(self, request: GraspHold) -> FloatArray:
        if request.target_kind == CATHETER_SEGMENT:
            position = self._system.geometry.rod.position
            first, weights, _ = point_on_curve(position, request.target + request.target_weights[1])
            point: FloatArray = np.asarray(weights) @ position[first : first + 3]
            return point
        return self._system.bodies.duct.point_at_start(request.target, request.target_weights)

    def _drop(self, hold_id: int) -> None:
        self.arrays.remove(list(self.active).index(hold_id))
        del self.active[hold_id]


def _replaces_contacts(request: GraspHold) -> bool:
    """Return whether a hold replaces the contacts of the jaws with the body that it holds.

    It does not if opening jaws no longer squeeze a catheter: then they must collide with it, or it would pass through
    them. The contacts of a held wall remain active in any case.
    """
    return request.limit_n > 0.0 or request.target_kind != CATHETER_SEGMENT


def _are_weights(u: float, v: float, w: float) -> bool:
    """Return whether these are barycentric weights of a point inside a triangle or segment, up to the tolerance."""
    least = -WEIGHT_TOLERANCE
    return abs(u + v + w - 1.0) <= WEIGHT_TOLERANCE and u >= least and v >= least and w >= least
