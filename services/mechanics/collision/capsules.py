"""Capsule against capsule: segments of tools against segments of the catheter, and the catheter against itself.

The normal of each pair of segments within reach is stored. If the axes have passed through each other, the new normal
is opposite to the stored one: then the stored one is kept and the distance is negative, so that bodies cannot pass
through each other. At a free end the normal may rotate freely. Every segment of the catheter within reach is a pair of
its own, so that two parallel bodies cannot rotate about a single contact.
"""

from __future__ import annotations

import math
from typing import Annotated

from trocar.services.mechanics.arrays import BoolArray, ByteArray, FloatArray
from trocar.services.mechanics.collision.candidate_list import LOOK_AHEAD_M
from trocar.services.mechanics.collision.pairs import CATHETER_SEGMENT, NO_TOOL, ContactPairs, pairs_at, write_pair
from trocar.services.mechanics.collision.primitives import closest_of_segments
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Address, Struct, reader
from trocar.services.mechanics.compiled.vectors import (
    Vector,
    along,
    cross,
    dot,
    put_row_of,
    row,
    row_of,
    scaled,
    squared_distance,
    subtract,
    unit,
)

Tools = tuple[FloatArray, FloatArray, BoolArray]
"""(segments (n_tools, 3, 2, 3), radii (n_tools, 3), zero where there is no segment, present (n_tools,))."""

Segment = tuple[Vector, Vector]
"""Start and end."""

#: Distance of two axes below which the direction between them is undefined; smaller differences of distances are zero.
_NO_DIRECTION_M = 1e-9


class CapsuleMemory(Struct):
    """The state of pairs of m first segments and n second ones from the last tick."""

    active: Annotated[ByteArray, "m", "n"]  # one where the pair was within reach at the last tick
    normal: Annotated[FloatArray, "m", "n", 3]  # towards the first body, of active pairs

    def reset(self) -> None:
        """Clear the state of every pair."""
        self.active[:] = 0


capsules_at = reader(CapsuleMemory)


@kernel
def track_pair(
    memory: CapsuleMemory, i: int, j: int, first: Segment, second: Segment, reach: float
) -> tuple[float, float, float, Vector]:
    """Return (s, t, signed distance of the axes in m, normal towards the first segment), and store the normal.

    Out of reach the distance is infinite.
    """
    was_active = memory.active[i, j] == 1
    side = row_of(memory.normal, i, j) if was_active else (0.0, 0.0, 0.0)
    s, t, distance, normal = measure_pair(first, second, side)
    if not abs(distance) < reach:
        memory.active[i, j] = 0
        return (s, t, math.inf, normal)
    if not was_active and distance <= _NO_DIRECTION_M:
        normal = unit(cross(subtract(first[1], first[0]), subtract(second[1], second[0])))
    memory.active[i, j] = 1
    put_row_of(memory.normal, i, j, normal)
    return (s, t, distance, normal)


@kernel
def measure_pair(first: Segment, second: Segment, side: Vector) -> tuple[float, float, float, Vector]:
    """Return the tuple of `track_pair` for two segments whose last normal was ``side``."""
    s, t, d2 = closest_of_segments(first[0], first[1], second[0], second[1])
    distance, normal = math.sqrt(d2), side
    if distance > _NO_DIRECTION_M:
        normal = scaled(vector_between(first, second, s, t), 1.0 / distance)
    if 0.0 < s < 1.0 and dot(normal, side) < 0.0:
        return s, t, -distance, scaled(normal, -1.0)
    return s, t, distance, normal


@kernel
def ends_of(ends: FloatArray, i: int) -> Segment:
    """Return start and end of piece i of ``ends`` (p, 2, 3)."""
    return row_of(ends, i, 0), row_of(ends, i, 1)


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
            second, apart_m = (row(particles, j), row(particles, j + 1)), radius[tool, segment] + sizes[0][j]
            reach, first = apart_m + max(sizes[1], LOOK_AHEAD_M), ends_of(segments[tool], segment)
            if _boxes_are_apart(first, second, reach):
                memory.active[i, j], last_t = 0, 0.0
                continue
            s, t, distance, normal = track_pair(memory, i, j, first, second, reach)
            if distance - apart_m < sizes[1] and not (t == 0.0 and last_t == 1.0):
                pair = (tool, segment, -1, CATHETER_SEGMENT, j, s, (1.0 - t, t, 0.0))
                write_pair(pairs, pair, distance - apart_m, normal)
            last_t = t


@kernel
def _boxes_are_apart(first: Segment, second: Segment, reach: float) -> bool:
    """Return whether the boxes round two segments, along the axes, are further apart than ``reach``."""
    (a, b), (c, d) = first, second
    for axis in range(3):
        apart = max(min(a[axis], b[axis]) - max(c[axis], d[axis]), min(c[axis], d[axis]) - max(a[axis], b[axis]))
        if apart > reach:
            return True
    return False


@kernel
def self_clearance_m(particles: FloatArray, n_apart: int, thickness: float) -> float:
    """Return a lower bound (m) on the gap between any two segments that `detect_self` may pair."""
    least = math.inf
    for i in range(particles.shape[0] - 1):
        first = row(particles, i), row(particles, i + 1)
        for j in range(i + n_apart, particles.shape[0] - 1):
            half, middles_2 = _halves_and_middles(first, (row(particles, j), row(particles, j + 1)))
            least = min(least, 0.5 * math.sqrt(middles_2) - half - thickness)
    return least


@kernel
def _halves_and_middles(first: Segment, second: Segment) -> tuple[float, float]:
    """Return the sum of half of both lengths, and four times the squared distance of the midpoints."""
    (a, b), (c, d) = first, second
    half = 0.5 * (math.sqrt(squared_distance(a, b)) + math.sqrt(squared_distance(c, d)))
    return half, squared_distance(along(a, b, 1.0), along(c, d, 1.0))


@kernel
def detect_self(
    addresses: tuple[Address[CapsuleMemory], Address[ContactPairs]],
    particles: FloatArray,
    n_apart: int,
    sizes: tuple[float, float],
) -> None:
    """Append pairs of segments of one catheter; ``sizes`` is (its diameter, margin) in m.

    The indices of both segments differ by at least ``n_apart``, which is 2 or more: neighbours always touch, and a
    catheter cannot be bent to a radius below about its own.
    """
    memory, pairs, (thickness, margin) = capsules_at(addresses[0]), pairs_at(addresses[1]), sizes
    n = memory.active.shape[0]
    for i in range(n):
        first = row(particles, i), row(particles, i + 1)
        for j in range(i + n_apart, n):
            second = row(particles, j), row(particles, j + 1)
            half, middles_2 = _halves_and_middles(first, second)
            # If the midpoints are further from each other than both halves plus the reach, the segments cannot touch.
            if middles_2 > 4.0 * (half + thickness + margin) ** 2:
                memory.active[i, j] = 0
                continue
            s, t, distance, normal = track_pair(memory, i, j, first, second, thickness + margin)
            # Two segments that share a particle would give the same pair twice: only the later one is written.
            if distance - thickness < margin and (s < 1.0 or i == n - 1) and (t < 1.0 or j == n - 1):
                pair = (NO_TOOL, 0, i, CATHETER_SEGMENT, j, s, (1.0 - t, t, 0.0))
                write_pair(pairs, pair, distance - thickness, normal)
