"""Grasps of the jaws: they begin when both jaws touch while closing, and end on opening."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.collision.pairs import (
    CATHETER_SEGMENT,
    DUCT_TRIANGLE,
    JAW_A,
    JAW_B,
    ContactPairs,
    pairs_at,
)
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Address
from trocar.services.mechanics.scene import CatheterScene, ForcepsScene
from trocar.services.mechanics.scene.tools import N_TOOLS, GraspHold
from trocar.services.mechanics.surface.mesh import TriangleMesh

GRASP_GAP_M = 0.1e-3


class JawState(NamedTuple):
    """Opening of the jaws, and the opening commanded by the handle."""

    proxy_angle_rad: float
    commanded_angle_rad: float


@dataclass(slots=True)
class Grasp:
    """Grasp of one forceps: open, or holding two points of one body.

    It closes when both jaws touch the same body from opposite sides and the handle squeezes it with at least
    ``grasp_torque_nm``; two points are held, so that the body cannot spin about one. It opens when the handle
    opens by ``release_angle_rad`` beyond where it closed.

    The largest force of a grasp is 2 mu N with N = torque / lever, as both jaws press with N: the handle's squeeze
    limits it in every tick.
    """

    tool: int
    forceps: ForcepsScene
    mesh: TriangleMesh
    catheter: CatheterScene
    holds: list[GraspHold] = field(default_factory=list)
    _lever_m: float = 0.0
    _next_id: int = 0
    _saved: tuple[list[GraspHold], float, int] = field(default_factory=lambda: ([], 0.0, 0))

    def update(self, pairs: ContactPairs, jaws: JawState) -> list[GraspHold]:
        """Update by the contacts and jaw angles of this tick and return the holds, a live list until the next call."""
        if self.holds:
            stop = self.holds[0].jaw_angle_rad
            if jaws.commanded_angle_rad > stop + self.forceps.release_angle_rad:
                self.holds.clear()
            else:
                is_wall = self.holds[0].target_kind == DUCT_TRIANGLE  # a wall keeps yielding
                self._set_limit((jaws.proxy_angle_rad if is_wall else stop) - jaws.commanded_angle_rad)
        elif self.may_close(jaws):
            self._try_to_close(pairs, jaws)
        return self.holds

    def may_close(self, jaws: JawState) -> bool:
        """Return whether nothing is held and the handle squeezes; only then are the contacts of a tick needed."""
        squeeze_rad = jaws.proxy_angle_rad - jaws.commanded_angle_rad
        return not self.holds and self._torque_nm(squeeze_rad) >= self.forceps.grasp_torque_nm

    def let_go(self) -> None:
        """Release all holds."""
        self.holds.clear()

    def save_start(self) -> None:
        """Save the state at the start of a step."""
        self._saved = list(self.holds), self._lever_m, self._next_id

    def restore_start(self) -> None:
        """Restore it, except for the limits of holds, which follow the handle."""
        self.holds, self._lever_m, self._next_id = self._saved

    def compile_kernels(self, pairs: ContactPairs) -> None:
        """Compile what looks for something to hold: jaws that close may touch nothing for as long as they like."""
        deepest_touches(pairs, self.tool, DUCT_TRIANGLE)
        rest_distance_m(pairs, self.mesh, 0, 0)

    def _torque_nm(self, squeeze_rad: float) -> float:
        return self.forceps.jaw_stiffness_nm_rad * squeeze_rad

    def _set_limit(self, squeeze_rad: float) -> None:
        push_n = max(self._torque_nm(squeeze_rad), 0.0) / self._lever_m
        for hold in self.holds:
            hold.limit_n = 2.0 * self.forceps.grip_friction * push_n / len(self.holds)

    def _try_to_close(self, pairs: ContactPairs, jaws: JawState) -> None:
        for kind in (CATHETER_SEGMENT, DUCT_TRIANGLE):
            a, b = deepest_touches(pairs, self.tool, kind)
            if a < 0 or b < 0:
                continue
            points = self._catheter_points(pairs, a, b) if kind == CATHETER_SEGMENT else self._wall_points(pairs, a, b)
            if points:
                parameter = 0.5 * float(pairs.tool_parameter[a] + pairs.tool_parameter[b])
                self._lever_m = max(parameter * self.forceps.jaw_length_m, self.forceps.jaw_radius_m)
                self._close(kind, points, jaws)
                return

    def _close(self, kind: int, points: list[tuple[int, FloatArray]], jaws: JawState) -> None:
        for target, weights in points:
            self.holds.append(GraspHold(self._new_id(), self.tool, kind, target, weights, 0.0, jaws.proxy_angle_rad))
        self._set_limit(jaws.proxy_angle_rad - jaws.commanded_angle_rad)

    def _new_id(self) -> int:
        """Return a new hold id; each tool counts in a residue class of its own, so ids of tools never collide."""
        self._next_id += 1
        return N_TOOLS * self._next_id + self.tool

    def _catheter_points(self, pairs: ContactPairs, a: int, b: int) -> list[tuple[int, FloatArray]]:
        """Return two points of the catheter a jaw's width apart, about the middle of both jaws' contacts."""
        at_a = float(pairs.target[a] + pairs.target_weights[a, 1])
        at_b = float(pairs.target[b] + pairs.target_weights[b, 1])
        width = self.forceps.jaw_radius_m / (self.catheter.length_m / self.catheter.n_segments)
        if abs(at_a - at_b) > 2.0 * width + 1.0:
            return []
        middle = 0.5 * (at_a + at_b)
        return [self._catheter_point(middle - 0.5 * width), self._catheter_point(middle + 0.5 * width)]

    def _catheter_point(self, at: float) -> tuple[int, FloatArray]:
        """Return segment and weights of a place along the catheter, counted in segments and clamped to its ends."""
        n_segments = self.catheter.n_rod_segments
        at = min(max(at, 0.0), float(n_segments))
        segment = min(int(at), n_segments - 1)
        return segment, np.array([1.0 - (at - segment), at - segment, 0.0])

    def _wall_points(self, pairs: ContactPairs, a: int, b: int) -> list[tuple[int, FloatArray]]:
        """Return the touched points on both faces, if they are of one fold of wall and not of two sides of the tube."""
        if rest_distance_m(pairs, self.mesh, a, b) > 4.0 * self.forceps.jaw_radius_m:
            return []
        return [(int(pairs.target[i]), pairs.target_weights[i].copy()) for i in (a, b)]


def deepest_touches(pairs: ContactPairs, tool: int, target_kind: int) -> tuple[int, int]:
    """Return the index of each jaw's deepest pair with this kind of target, -1 if none touches."""
    found: tuple[int, int] = find_deepest_touches(pairs.address, tool, target_kind)
    return found


def rest_distance_m(pairs: ContactPairs, mesh: TriangleMesh, a: int, b: int) -> float:
    """Return the distance in m between the touched points of two pairs on the wall at rest."""
    apart_m: float = find_rest_distance(pairs.address, mesh.vertices_m, mesh.triangles, a, b)
    return apart_m


@kernel
def find_rest_distance(
    pairs_address: Address[ContactPairs], vertices: FloatArray, triangles: IntArray, a: int, b: int
) -> float:
    """Kernel of `rest_distance_m`, which takes a tenth of the time."""
    pairs, square = pairs_at(pairs_address), 0.0
    for axis in range(3):
        way = 0.0
        for corner in range(3):
            way += pairs.target_weights[a, corner] * vertices[triangles[pairs.target[a], corner], axis]
            way -= pairs.target_weights[b, corner] * vertices[triangles[pairs.target[b], corner], axis]
        square += way * way
    return math.sqrt(square)


@kernel
def find_deepest_touches(pairs_address: Address[ContactPairs], tool: int, target_kind: int) -> tuple[int, int]:
    """Kernel of `deepest_touches`."""
    pairs, a, b = pairs_at(pairs_address), -1, -1
    for i in range(pairs.count):
        gap_m = pairs.gap_m[i]
        if pairs.tool[i] != tool or pairs.target_kind[i] != target_kind or gap_m >= GRASP_GAP_M:
            continue
        if pairs.tool_segment[i] == JAW_A and (a < 0 or gap_m < pairs.gap_m[a]):
            a = i
        elif pairs.tool_segment[i] == JAW_B and (b < 0 or gap_m < pairs.gap_m[b]):
            b = i
    return a, b
