"""Capsules and spheres against segments of the catheter: segments of tools, its own other strands, and stones.

The normal of each pair within reach is stored. If the axes come nearer than half of their distance in contact, or have
passed through each other, the stored normal is kept and the distance is that along it, negative beyond the axis, so
that bodies cannot pass through each other. Only at a free end of a tool may the normal rotate freely. Elsewhere bodies
that stay apart cannot turn it by a right angle within a step: they would have to move by more than their distance, and
a joint between two segments is no end. Every segment of the catheter within reach is a pair of its own, so that two
parallel bodies cannot rotate about a single contact.
"""

from __future__ import annotations

import math
from typing import Annotated

from trocar.services.mechanics.arrays import BoolArray, ByteArray, FloatArray
from trocar.services.mechanics.collision.candidate_list import LOOK_AHEAD_M
from trocar.services.mechanics.collision.pairs import CATHETER_SEGMENT, JAW_A, SHAFT, ContactPairs, write_pair
from trocar.services.mechanics.collision.primitives import closest_of_segments
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Struct, reader
from trocar.services.mechanics.compiled.vectors import (
    Vector,
    along,
    cross,
    dot,
    put_row_of,
    row,
    row_of,
    scaled,
    subtract,
    unit,
)

Tools = tuple[FloatArray, FloatArray, BoolArray]
"""(segments (n_tools, 3, 2, 3), radii (n_tools, 3), zero where there is no segment, present (n_tools,))."""

Segment = tuple[Vector, Vector]
"""Start and end."""

Ends = tuple[bool, bool]
"""Whether a body ends where its segment starts, and where it ends: there a normal may rotate freely."""
NO_END: Ends = (False, False)

#: Distance of two axes, as a fraction of that in contact, below which the direction between them tells no side: a small
#: motion turns it by any angle.
UNRELIABLE_DEPTH = 0.5
#: Distance of two axes below which the direction between them is undefined; smaller differences of distances are zero.
_NO_DIRECTION_M = 1e-9


class CapsuleMemory(Struct):
    """The state of pairs of m first segments and n second ones from the last tick."""

    active: Annotated[ByteArray, "m", "n"]  # one where the pair was within reach at the last tick
    normal: Annotated[FloatArray, "m", "n", 3]  # towards the first body, of active pairs
    n_apart: int = 0  # from so many segments apart on the catheter touches itself; 0 if it does not

    def reset(self) -> None:
        """Clear the state of every pair."""
        self.active[:] = 0


capsules_at = reader(CapsuleMemory)


@kernel
def track_pair(
    memory: CapsuleMemory, place: tuple[int, int], first: Segment, second: Segment, limits: tuple[float, float, Ends]
) -> tuple[float, float, float, Vector]:
    """Return (s, t, signed distance of the axes in m, normal towards the first segment), and store the normal.

    ``place`` is the pair's in the memory, ``limits`` are (reach in m, distance of the axes in contact in m, free ends
    of the first body). Out of reach the distance is infinite.
    """
    (i, j), (reach, apart_m, free) = place, limits
    was_active = memory.active[i, j] == 1
    side = row_of(memory.normal, i, j) if was_active else (0.0, 0.0, 0.0)
    s, t, distance, normal = measure_pair(first, second, side, (apart_m, free))
    if not abs(distance) < reach:
        memory.active[i, j] = 0
        return (s, t, math.inf, normal)
    if not was_active and distance <= _NO_DIRECTION_M:
        normal = unit(cross(subtract(first[1], first[0]), subtract(second[1], second[0])))
    memory.active[i, j] = 1
    put_row_of(memory.normal, i, j, normal)
    return (s, t, distance, normal)


@kernel
def measure_pair(
    first: Segment, second: Segment, side: Vector, limits: tuple[float, Ends]
) -> tuple[float, float, float, Vector]:
    """Return the tuple of `track_pair` for two segments whose last normal was ``side``, zero if there was none.

    ``limits`` are its last two.
    """
    s, t, d2 = closest_of_segments(first[0], first[1], second[0], second[1])
    distance, normal, between = math.sqrt(d2), side, vector_between(first, second, s, t)
    if distance > _NO_DIRECTION_M:
        normal = scaled(between, 1.0 / distance)
    apart_m, free = limits
    is_free = (free[0] and s == 0.0) or (free[1] and s == 1.0)
    is_known = not is_free and dot(side, side) > 0.0
    if is_known and (distance < UNRELIABLE_DEPTH * apart_m or dot(normal, side) < 0.0):
        return s, t, dot(between, side), side
    return s, t, distance, normal


@kernel
def ends_of(ends: FloatArray, i: int) -> Segment:
    """Return start and end of piece i of ``ends`` (p, 2, 3)."""
    return row_of(ends, i, 0), row_of(ends, i, 1)


@kernel
def segment_at(particles: FloatArray, j: int) -> Segment:
    """Return segment j of the catheter."""
    return row(particles, j), row(particles, j + 1)


@kernel
def free_ends(segment: int, has_jaws: bool) -> Ends:
    """Return where a segment of a tool is an end of the tool; a shaft without length, a sphere, has no side."""
    return segment == SHAFT, segment != SHAFT or not has_jaws


@kernel
def vector_between(first: Segment, second: Segment, s: float, t: float) -> Vector:
    """Return the vector from the point at t of the second of two segments to the point at s of the first."""
    (a, b), (c, d) = first, second
    return subtract(along(a, subtract(b, a), s), along(c, subtract(d, c), t))


@kernel
def detect_capsules(
    memory: CapsuleMemory, pairs: ContactPairs, tools: Tools, particles: FloatArray, sizes: tuple[FloatArray, float]
) -> None:
    """Append pairs of tool segments with catheter segments; ``sizes`` is (radii of catheter segments, margin) in m.

    Normals are stored for all pairs that a step may bring into contact. Two segments that share a particle may give the
    same pair twice: then only the earlier one is appended.
    """
    segments, radius, present = tools
    n_segments = segments.shape[1]
    for i in range(segments.shape[0] * n_segments):
        tool, segment, last_t = i // n_segments, i % n_segments, 0.0
        for j in range(memory.active.shape[1]):
            if not present[tool] or radius[tool, segment] <= 0.0:
                memory.active[i, j] = 0
                continue
            second, apart_m = segment_at(particles, j), radius[tool, segment] + sizes[0][j]
            reach, first = apart_m + max(sizes[1], LOOK_AHEAD_M), ends_of(segments[tool], segment)
            if boxes_are_apart(first, second, reach):
                memory.active[i, j], last_t = 0, 0.0
                continue
            limits = reach, apart_m, free_ends(segment, radius[tool, JAW_A] > 0.0)
            s, t, distance, normal = track_pair(memory, (i, j), first, second, limits)
            if distance - apart_m < sizes[1] and not (t == 0.0 and last_t == 1.0):
                pair = (tool, segment, -1, CATHETER_SEGMENT, j, s, (1.0 - t, t, 0.0))
                write_pair(pairs, pair, distance - apart_m, normal)
            last_t = t


@kernel
def boxes_are_apart(first: Segment, second: Segment, reach: float) -> bool:
    """Return whether the boxes round two segments, along the axes, are further apart than ``reach``."""
    (a, b), (c, d) = first, second
    for axis in range(3):
        apart = max(min(a[axis], b[axis]) - max(c[axis], d[axis]), min(c[axis], d[axis]) - max(a[axis], b[axis]))
        if apart > reach:
            return True
    return False
