"""Contacts of the catheter's segments with the edge of an opening, where it crosses between two particles."""

from __future__ import annotations

import math
from typing import Annotated, Self

import numpy as np

from services.mechanics.arrays import FloatArray, IntArray
from services.mechanics.collision.ahead import is_met_first, places_of, slide_of
from services.mechanics.collision.folds import flank_on, is_new_flank
from services.mechanics.collision.nodes import corner_positions
from services.mechanics.collision.pairs import DUCT_TRIANGLE, NO_TOOL, ContactPairs
from services.mechanics.collision.primitives import index
from services.mechanics.collision.probes import SKIN_M
from services.mechanics.collision.search import NOT_FOUND, Touch, closest, distance_to_all, offset, walk
from services.mechanics.collision.shell import Shell
from services.mechanics.collision.writer import is_due, write_pair
from services.mechanics.compiled import inlined_kernel, kernel
from services.mechanics.compiled.struct import Struct
from services.mechanics.compiled.vectors import (
    Vector,
    along,
    combine,
    dot,
    put_row,
    put_row_of,
    row,
    row_of,
    scaled,
    squared_distance,
    subtract,
)

_TOUCHING_M = 1e-9


class RimMemory(Struct):
    """What m segments of a catheter remember of the rims."""

    edge: Annotated[IntArray, "m"]  # rim edge within reach of each segment at the last tick, or NOT_FOUND
    place: Annotated[FloatArray, "m", 3]  # weights of the point touched
    normal: Annotated[FloatArray, "m", 3]  # towards the segment
    ends: Annotated[FloatArray, "m", 2, 3]  # of the segment at the last search that found no edge within reach
    travel: Annotated[FloatArray, "m"]  # the wall's travel then
    slack: Annotated[
        FloatArray, "m"
    ]  # motion of segment and wall after which an edge may be in reach; negative: search

    @classmethod
    def allocate(cls, m: int) -> Self:
        """Return m segments without a past."""
        return cls.zeros(m=m, edge=np.full(m, NOT_FOUND, np.int32), slack=np.full(m, -1.0))

    def reset(self) -> None:
        """Drop the past of every segment."""
        self.edge.fill(NOT_FOUND)
        self.slack.fill(-1.0)


@inlined_kernel
def detect_rims(
    shell: Shell,
    memory: RimMemory,
    positions: FloatArray,
    motions: FloatArray,
    sizes: tuple[float, float],
    pairs: ContactPairs,
) -> None:
    """Append pairs of segments with rim edges.

    ``positions`` and ``motions``, as expected of this tick, are those of the particles (n, 3); ``sizes`` holds (radius
    + half thickness, margin).
    """
    for i in range(positions.shape[0] - 1):
        ends = (row(positions, i), row(positions, i + 1))
        _detect_segment(shell, memory, i, ends, (row(motions, i), row(motions, i + 1)), sizes, pairs)


@inlined_kernel
def _detect_segment(
    shell: Shell,
    memory: RimMemory,
    i: int,
    ends: tuple[Vector, Vector],
    motions: tuple[Vector, Vector],
    sizes: tuple[float, float],
    pairs: ContactPairs,
) -> None:
    thickness, margin = sizes
    moved = math.sqrt(max(dot(motions[0], motions[0]), dot(motions[1], motions[1])))
    if _is_still_far(shell, memory, i, ends, moved):
        return
    reach = thickness + margin + moved
    touch = closest(shell.body, shell.rims, ends[0], ends[1], reach + SKIN_M, index(NOT_FOUND))
    memory.slack[i] = -1.0
    if not touch[1] < reach * reach:
        _note_far(shell, memory, i, ends, math.sqrt(touch[1]), thickness + margin)
        return
    distance, normal = _signed(shell, memory, i, touch, ends, thickness)
    start = pairs.count
    _write(shell, i, touch, (distance, normal), motions, sizes, pairs)
    if distance > 0.0:
        _write_flanks(shell, i, (touch[0], normal, reach), ends, motions, sizes, pairs, start)
        _write_ahead(shell, i, (touch, normal, distance), ends, motions, sizes, pairs, start)


@inlined_kernel
def _write_ahead(
    shell: Shell,
    i: int,
    found: tuple[Touch, Vector, float],
    ends: tuple[Vector, Vector],
    motions: tuple[Vector, Vector],
    sizes: tuple[float, float],
    pairs: ContactPairs,
    start: int,
) -> None:
    """Append pairs with the edges that a segment will be closest to while it slides along the one ``found``."""
    touch, normal, distance = found
    middle = _between(motions, touch[2])
    slide = slide_of(middle, normal, distance - sizes[0])
    places, stopped = places_of(slide, normal), subtract(slide, middle)
    reach = sizes[0] + sizes[1] + math.sqrt(dot(slide, slide))
    for place in range(places):
        share = (place + 1) / places
        ways = (scaled(along(motions[0], stopped, 1.0), share), scaled(along(motions[1], stopped, 1.0), share))
        a, b = along(ends[0], ways[0], 1.0), along(ends[1], ways[1], 1.0)
        touch = walk(shell.body, shell.rims, index(touch[0]), a, b, reach)
        if touch[0] == NOT_FOUND or not _TOUCHING_M**2 < touch[1] < reach * reach:
            return
        there, away = _apart(shell, touch, (a, b))
        way = _between(ways, touch[2])
        if dot(away, normal) > 0.0 and is_met_first(pairs, start, way, (there - sizes[0], away)):
            _write(shell, i, touch, (there - dot(way, away), away), ways, sizes, pairs)


@kernel
def _apart(shell: Shell, touch: Touch, ends: tuple[Vector, Vector]) -> tuple[float, Vector]:
    """Return how far a segment is from the edge that it touches, which is not on it, and in which direction."""
    distance = math.sqrt(touch[1])
    return distance, scaled(offset(shell.body, shell.rims, touch, ends[0], ends[1]), 1.0 / distance)


@kernel
def _between(motions: tuple[Vector, Vector], s: float) -> Vector:
    """Return the motion at s of a segment whose ends move like this."""
    return along(scaled(motions[0], 1.0 - s), motions[1], s)


@inlined_kernel
def _write_flanks(
    shell: Shell,
    i: int,
    found: tuple[int, Vector, float],
    ends: tuple[Vector, Vector],
    motions: tuple[Vector, Vector],
    sizes: tuple[float, float],
    pairs: ContactPairs,
    start: int,
) -> None:
    """Append pairs with the edges beside the one ``found``, where the rim bends round the segment; see `folds`."""
    rims, (edge, normal, reach) = shell.rims, found
    begin, ring = rims.ring_start, rims.ring
    for corner in range(2):
        vertex = rims.triangles[edge, corner]
        for place in range(begin[vertex], begin[vertex + 1]):
            touch = flank_on(shell.body, rims, edge, ring[place], ends, reach)
            if touch[0] == NOT_FOUND or touch[1] < _TOUCHING_M**2:
                continue
            distance, away = _apart(shell, touch, ends)
            if dot(away, normal) > 0.0 and is_new_flank(pairs, start, away):
                _write(shell, i, touch, (distance, away), motions, sizes, pairs)


@kernel
def _is_still_far(shell: Shell, memory: RimMemory, i: int, ends: tuple[Vector, Vector], ahead: float) -> bool:
    """Return whether segment and wall have moved too little since the last search to meet within ``ahead`` more."""
    slack = memory.slack[i]
    if slack < 0.0:
        return False
    moved_a = squared_distance(ends[0], row_of(memory.ends, i, 0))
    moved_b = squared_distance(ends[1], row_of(memory.ends, i, 1))
    is_far: bool = math.sqrt(max(moved_a, moved_b)) + shell.body.travel - memory.travel[i] + ahead < slack
    return is_far


@inlined_kernel
def _note_far(
    shell: Shell, memory: RimMemory, i: int, ends: tuple[Vector, Vector], distance: float, reach: float
) -> None:
    memory.edge[i] = NOT_FOUND
    for end in range(2):
        put_row_of(memory.ends, i, end, ends[end])
    memory.travel[i] = shell.body.travel_noted
    memory.slack[i] = max(distance, distance_to_all(shell.body, shell.rims, ends[0], ends[1])) - reach


@kernel
def _signed(
    shell: Shell, memory: RimMemory, i: int, touch: Touch, ends: tuple[Vector, Vector], thickness: float
) -> tuple[float, Vector]:
    """Return distance and normal, negative and turned back where the segment has been drawn through the edge."""
    edges, normals = memory.edge, memory.normal
    away = offset(shell.body, shell.rims, touch, ends[0], ends[1])
    distance, old = math.sqrt(dot(away, away)), row(normals, i)
    is_known = edges[i] != NOT_FOUND and _is_same_lip(shell, memory, i, touch, thickness)
    normal = scaled(away, 1.0 / distance) if distance > _TOUCHING_M else old
    if is_known and 0.0 < touch[2] < 1.0 and dot(normal, old) < 0.0:
        normal, distance = scaled(normal, -1.0), -distance
    edges[i] = touch[0]
    put_row(memory.place, i, touch[3])
    put_row(normals, i, normal)
    return distance, normal


@kernel
def _is_same_lip(shell: Shell, memory: RimMemory, i: int, touch: Touch, thickness: float) -> bool:
    """Return whether the point touched is near the last one: across a narrow mouth there is another lip."""
    p0, p1, p2 = corner_positions(shell.body, shell.rims, memory.edge[i])
    last = combine(row(memory.place, i), p0, p1, p2)
    q0, q1, q2 = corner_positions(shell.body, shell.rims, touch[0])
    return squared_distance(last, combine(touch[3], q0, q1, q2)) < thickness * thickness


@kernel
def _write(
    shell: Shell,
    i: int,
    touch: Touch,
    contact: tuple[float, Vector],
    motions: tuple[Vector, Vector],
    sizes: tuple[float, float],
    pairs: ContactPairs,
) -> None:
    """Append the pair of a touch with this distance and normal, unless it is a particle's own or too far away.

    It is one of the segment up to its very end: beside a particle's contact, which is further from the edge, one that
    comes and goes would let the particle sink in and be pushed out by turns.
    """
    s, gap, normal = touch[2], contact[0] - sizes[0], contact[1]
    if not (0.0 < s < 1.0 and is_due(gap, normal, _between(motions, s), sizes[1])):
        return
    owner = shell.rim_owner[touch[0]]
    start, end = touch[3][0], 1.0 - touch[3][0]
    weights = (start, end, 0.0)
    if owner % 3 == 1:
        weights = (0.0, start, end)
    elif owner % 3 == 2:
        weights = (end, 0.0, start)
    write_pair(pairs, (NO_TOOL, 0, i, DUCT_TRIANGLE, owner // 3, s, weights), gap, normal)
