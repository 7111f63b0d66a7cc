"""Contacts of tools with the wall that outlive detection, so that a tool rests on several points at once.

Detection reports the closest point. A wall that gives way under a force is then closest somewhere else, and a single
contact would hop round its own dent. Points of the wall that were pressed in the last tick stay candidates until
they are let go: a contact manifold, as rigid-body engines keep for boxes.
"""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np

from services.mechanics.arrays import FloatArray, IntArray
from services.mechanics.collision.pairs import DUCT_TRIANGLE, NO_TOOL, ContactPairs, PairArrays, pairs_at
from services.mechanics.compiled import kernel
from services.mechanics.contact import laws
from services.mechanics.contact.identity import target_kind_of, target_of, tool_segment_of
from services.mechanics.contact.rows import ContactRows, rows_at
from services.mechanics.contact.state import state_at

CAPACITY = 32
# A point seen from more than 60 degrees off its normal has slid round the tool.
FACING = 0.5


class NodePositions(Protocol):
    """Where nodes of the wall are at the start of the step."""

    def node_positions(self, nodes: IntArray, out: FloatArray) -> None:
        """Write the positions of ``nodes`` (k,) into ``out`` (k, 3), in m."""


class PressedPoints:
    """Points of the wall that tools pressed on in the last tick."""

    def __init__(self, half_thickness_m: float, margin_m: float) -> None:
        self._sizes = (half_thickness_m, margin_m)
        self._pairs = ContactPairs.allocate(CAPACITY)
        self._nodes = np.zeros(3 * CAPACITY, np.int32)
        self._corners = np.zeros((3 * CAPACITY, 3))

    def keep(self, rows: ContactRows) -> None:
        """Remember the pressed points of the rows just solved."""
        self._pairs.count = keep_pressed(rows.address, self._pairs.address, self._nodes)

    def append_to(self, pairs: ContactPairs, wall: NodePositions, state_address: int) -> None:
        """Append those that are still within reach and that ``pairs`` does not have."""
        kept = self._pairs.count
        if kept == 0:
            return
        corners = self._corners[: 3 * kept]
        wall.node_positions(self._nodes[: 3 * kept], corners)
        pairs.count = append_pressed(
            state_address, self._pairs.address, kept, corners, self._sizes, pairs.address, pairs.count
        )


@kernel
def keep_pressed(rows_address: int, pairs_address: int, nodes: IntArray) -> int:
    """Copy pressed contacts of tools with the wall to the pairs and return how many; names are decoded from the rows.

    ``nodes`` (3 C,) takes the corners of their triangles.
    """
    rows, out = rows_at(rows_address), pairs_at(pairs_address)
    count = 0
    for row in range(rows.used[0]):
        on_wall = target_kind_of(rows.identity[row]) == DUCT_TRIANGLE
        presses = laws.HAS_GAP[rows.law[row]] and rows.force_n[row, 0] > 0.0
        if not presses or rows.tool[row] == NO_TOOL or not on_wall:
            continue
        if count == out.target.shape[0]:
            break
        out.tool[count] = rows.tool[row]
        out.tool_segment[count] = tool_segment_of(rows.identity[row])
        out.particle[count] = -1
        out.target_kind[count] = DUCT_TRIANGLE
        out.target[count] = target_of(rows.identity[row])
        for axis in range(3):
            nodes[3 * count + axis] = rows.duct_node[row, axis]
            out.target_weights[count, axis] = rows.duct_weight[row, axis]
            out.normal[count, axis] = rows.frame[row, 0, axis]
        count += 1
    return count


@kernel
def append_pressed(
    state_address: int,
    kept_address: int,
    n_kept: int,
    corners: FloatArray,
    sizes: tuple[float, float],
    pairs_address: int,
    count: int,
) -> int:
    """Append kept points to pairs, of which there are ``count``, with fresh normals; return how many there are then.

    ``sizes`` are half the wall's thickness and the gap up to which a point is a candidate.
    """
    tools, kept, out = state_at(state_address).geometry.tools, pairs_at(kept_address), pairs_at(pairs_address)
    n_detected = count
    for i in range(n_kept):
        if count == out.target.shape[0] or _is_known(kept, i, out, n_detected):
            continue
        tool, segment = kept.tool[i], kept.tool_segment[i]
        ends = tools.segments[tool, segment]
        along, length_2 = 0.0, 0.0
        for axis in range(3):
            edge = ends[1, axis] - ends[0, axis]
            point = 0.0
            for corner in range(3):
                point += kept.target_weights[i, corner] * corners[3 * i + corner, axis]
            out.normal[count, axis] = point
            along += edge * (point - ends[0, axis])
            length_2 += edge * edge
        s = min(max(along / length_2, 0.0), 1.0) if length_2 > 0.0 else 0.0
        distance_2, facing = 0.0, 0.0
        for axis in range(3):
            away = (1.0 - s) * ends[0, axis] + s * ends[1, axis] - out.normal[count, axis]
            out.normal[count, axis] = away
            distance_2 += away * away
            facing += away * kept.normal[i, axis]
        distance = math.sqrt(distance_2)
        reach = tools.radius[tool, segment] + sizes[0] + sizes[1]
        if distance == 0.0 or distance > reach or facing < FACING * distance:
            continue
        out.tool[count], out.tool_segment[count], out.particle[count] = tool, segment, -1
        out.target_kind[count], out.target[count] = DUCT_TRIANGLE, kept.target[i]
        out.tool_parameter[count] = s
        for axis in range(3):
            out.normal[count, axis] /= distance
            out.target_weights[count, axis] = kept.target_weights[i, axis]
        count += 1
    return count


@kernel
def _is_known(kept: PairArrays, i: int, pairs: PairArrays, count: int) -> bool:
    """Whether detection reports the same triangle for the same segment of the tool."""
    for k in range(count):
        if (
            pairs.tool[k] == kept.tool[i]
            and pairs.tool_segment[k] == kept.tool_segment[i]
            and pairs.target_kind[k] == DUCT_TRIANGLE
            and pairs.target[k] == kept.target[i]
        ):
            return True
    return False
