"""The contact manifold: points of the wall that outlive detection, so that a tool rests on several of them at once.

Detection reports the closest point. A wall that gives way under a force is then closest somewhere else, and a single
contact would hop round its own dent. Points of the wall that were pressed in the last tick stay candidates until
they are let go, as rigid-body engines keep the corners of a box.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from services.mechanics.arrays import BoolArray, FloatArray, IntArray
from services.mechanics.collision.beside import FACING, apart_m, seen_from
from services.mechanics.collision.pairs import DUCT_TRIANGLE, NO_TOOL, ContactPairs, pairs_at
from services.mechanics.collision.writer import FULL, write_pair
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address
from services.mechanics.compiled.vectors import Vector, along, combine, dot, scaled, squared_distance
from services.mechanics.compiled.vectors import row as row_of
from services.mechanics.contact import laws
from services.mechanics.contact.geometry import ContactGeometry, WallGeometry, geometry_at, wall_at
from services.mechanics.contact.identity import target_kind_of, target_of, tool_segment_of
from services.mechanics.contact.rows import ContactRows, rows_at

CAPACITY = 64
# A kept point that stuck is a found one only where both are nearer than this part of the distance between axis and
# mid-surface, 30 um. Two edges of the wall under a jaw may be a tenth of a millimetre apart, and the one that is
# pressed lets the other come closest: with room for one of them they took turns. What slides is found anew.
ONE_POINT = 0.02


class NodePositions(Protocol):
    """Where nodes of the wall are at the start of the step."""

    def node_positions(self, nodes: IntArray, out: FloatArray) -> None:
        """Write the positions of ``nodes`` (k,) into ``out`` (k, 3), in m."""


class PressedPoints:
    """Points of the wall that were pressed in the last tick, and room for where they are now."""

    def __init__(self, wall: WallGeometry, margin_m: float) -> None:
        self._sizes = (wall.half_thickness, margin_m)
        self._wall = wall
        self._pairs = ContactPairs.allocate(CAPACITY)
        self._slid = np.zeros(CAPACITY, np.bool_)
        self._nodes = np.zeros(3 * CAPACITY, np.int32)
        self._corners = np.zeros((3 * CAPACITY, 3))

    @property
    def dropped(self) -> int:
        """Pressed points since the start that found no room to be kept."""
        return self._pairs.dropped

    def forget(self) -> None:
        """Let go of all points."""
        self._pairs.count = 0

    def _corners_now(self, wall: NodePositions) -> FloatArray:
        """Return where the corners (3 k, 3) of the points' triangles are."""
        n = 3 * self._pairs.count
        wall.node_positions(self._nodes[:n], self._corners[:n])
        return self._corners[:n]


class ContactManifold(PressedPoints):
    """Points of the wall that tools pressed on in the last tick."""

    def keep(self, rows: ContactRows, slides: BoolArray) -> None:
        """Remember the pressed points of the rows just solved; ``slides`` (C,) says which slid."""
        keep_pressed(rows.address, self._wall.address, self._pairs.address, (slides, self._slid, self._nodes))

    def append_to(self, pairs: ContactPairs, wall: NodePositions, geometry: ContactGeometry) -> None:
        """Append those that are still within reach and that ``pairs`` does not have, as far as there is room."""
        if self._pairs.count:
            states = (self._corners_now(wall), self._slid)
            append_pressed(geometry.address, self._pairs.address, states, self._sizes, pairs.address)


@kernel
def keep_pressed(
    rows_address: Address[ContactRows],
    wall_address: Address[WallGeometry],
    pairs_address: Address[ContactPairs],
    states: tuple[BoolArray, BoolArray, IntArray],
) -> None:
    """Make pairs of the pressed contacts of tools with the wall; their names are decoded from the rows.

    ``states`` say which rows slid, and take which of the pairs did, and the corners (3 C,) of their triangles.
    """
    rows, wall, out = rows_at(rows_address), wall_at(wall_address), pairs_at(pairs_address)
    slides, slid, nodes = states
    out.count = 0
    for row in range(rows.n_contacts):
        tool, identity = rows.tool[row], rows.identity[row]
        presses = laws.HAS_GAP[rows.law[row]] and rows.force_n[row, 0] > 0.0
        if presses and tool != NO_TOOL and target_kind_of(identity) == DUCT_TRIANGLE:
            weights, segment = row_of(rows.duct_weight, row), tool_segment_of(identity)
            pair = (tool, segment, -1, DUCT_TRIANGLE, target_of(identity), 0.0, weights)
            place = write_pair(out, pair, rows.gap_m[row], row_of(rows.frame[row], 0))
            if place != FULL:
                slid[place] = slides[row]
    write_corners(out, wall, nodes)


@kernel
def write_corners(pairs: ContactPairs, wall: WallGeometry, nodes: IntArray) -> None:
    """Write the corners of the triangles that pairs name into ``nodes`` (3 C,)."""
    for i in range(pairs.count):
        for corner in range(3):
            nodes[3 * i + corner] = wall.triangles[pairs.target[i], corner]


@kernel
def append_pressed(
    geometry_address: Address[ContactGeometry],
    kept_address: Address[ContactPairs],
    states: tuple[FloatArray, BoolArray],
    sizes: tuple[float, float],
    pairs_address: Address[ContactPairs],
) -> None:
    """Append kept points to pairs, with fresh normals.

    ``states`` are where the corners (3 k, 3) of their triangles are now, and which of them slid; ``sizes`` half the
    wall's thickness and the gap up to which a point is a candidate.
    """
    corners = states[0]
    tools, kept, out = geometry_at(geometry_address).tools, pairs_at(kept_address), pairs_at(pairs_address)
    n_found = out.count
    for i in range(kept.count):
        tool, segment = kept.tool[i], kept.tool_segment[i]
        weights, ends = row_of(kept.target_weights, i), tools.segments[tool, segment]
        axis = row_of(ends, 0), row_of(ends, 1)
        s, distance, normal = seen_from(kept_point(kept, corners, i), axis)
        thickness = tools.radius[tool, segment] + sizes[0]
        if distance == 0.0 or distance > thickness + sizes[1]:
            continue
        if _is_known(kept, i, (axis, thickness, 2.0 * sizes[0], n_found), states, out):
            continue
        if dot(normal, row_of(kept.normal, i)) < FACING:
            continue
        pair = (tool, segment, -1, DUCT_TRIANGLE, kept.target[i], s, weights)
        write_pair(out, pair, distance - thickness, normal)


@kernel
def kept_point(kept: ContactPairs, corners: FloatArray, i: int) -> Vector:
    """Return where a kept point is now."""
    at = row_of(corners, 3 * i), row_of(corners, 3 * i + 1), row_of(corners, 3 * i + 2)
    return combine(row_of(kept.target_weights, i), at[0], at[1], at[2])


@kernel
def _is_known(
    kept: ContactPairs,
    i: int,
    where: tuple[tuple[Vector, Vector], float, float, int],
    states: tuple[FloatArray, BoolArray],
    pairs: ContactPairs,
) -> bool:
    """Whether there is a pair of the same segment of the tool with the same point of the wall.

    Or, where the kept point slid, one that was found next to it and is no other kept point. ``where`` are the ends of
    the segment's axis, the thickness between axis and mid-surface, that of the wall, and how many pairs were found.
    """
    (corners, slid), (ends, thickness, wall_m, n_found) = states, where
    mine = kept_point(kept, corners, i)
    near, same = apart_m(thickness, wall_m), ONE_POINT * thickness
    for k in range(pairs.count):
        if pairs.tool[k] != kept.tool[i] or pairs.tool_segment[k] != kept.tool_segment[i]:
            continue
        if pairs.target_kind[k] != DUCT_TRIANGLE:
            continue
        s, normal = pairs.tool_parameter[k], row_of(pairs.normal, k)
        on_axis = along(scaled(ends[0], 1.0 - s), ends[1], s)
        known = along(on_axis, normal, -(pairs.gap_m[k] + thickness))
        apart_2 = squared_distance(known, mine)
        if apart_2 < same * same:
            return True
        is_beside = slid[i] and k < n_found and apart_2 < near * near
        if is_beside and not _is_another(kept, i, (known, apart_2, same), states):
            return True
    return False


@kernel
def _is_another(
    kept: ContactPairs, i: int, found: tuple[Vector, float, float], states: tuple[FloatArray, BoolArray]
) -> bool:
    """Whether a found point is where another kept one is, or has slid to, that is nearer than the ``i``-th.

    Two points that a tool rests on would be one otherwise as soon as one of them slips by a micrometre; the other gives
    way alone then, and they take turns. ``found`` is where it is, its squared distance, and how near stuck ones are.
    """
    (known, apart_2, same), (corners, slid) = found, states
    for j in range(kept.count):
        if j != i and kept.tool[j] == kept.tool[i] and kept.tool_segment[j] == kept.tool_segment[i]:
            other_2 = squared_distance(known, kept_point(kept, corners, j))
            if other_2 < apart_2 and (slid[j] or other_2 < same * same):
                return True
    return False
