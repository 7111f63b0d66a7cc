"""The catheter against itself, and stones against the catheter.

Segments of the catheter are told apart by how many lie between them: neighbours always touch, and a catheter cannot be
bent to a radius below about its own. Where the closest point of a pair is a joint that both of its segments share, the
pair of only one of them is taken.
"""

from __future__ import annotations

import math

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.collision.candidate_list import LOOK_AHEAD_M
from trocar.services.mechanics.collision.capsules import (
    NO_END,
    CapsuleMemory,
    Segment,
    boxes_are_apart,
    segment_at,
    track_pair,
)
from trocar.services.mechanics.collision.pairs import CATHETER_SEGMENT, ContactPairs, write_pair
from trocar.services.mechanics.collision.pieces import N_TOOL_PIECES, owner_of
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.vectors import along, dot, row, squared_distance

Spheres = tuple[FloatArray, FloatArray, FloatArray]
"""Centres (s, 3), free motion in the step (s, 3) and radii (s,), of which some exist."""


@kernel
def first_target(memory: CapsuleMemory, p: int) -> int:
    """Return the first segment of the catheter that piece p may touch; their number if there is none."""
    n = memory.active.shape[1]
    if p < N_TOOL_PIECES or p >= N_TOOL_PIECES + n:
        return 0
    return p - N_TOOL_PIECES + memory.n_apart if memory.n_apart > 0 else n


@kernel
def is_of_neighbour(memory: CapsuleMemory, pair: tuple[int, int], s: float, t: float) -> bool:
    """Return whether the closest points of (piece, segment) are also those of a neighbour's pair, which is taken."""
    p, j = pair
    if j == first_target(memory, p):
        return False
    return t == 0.0 or (s == 1.0 and N_TOOL_PIECES <= p < N_TOOL_PIECES + memory.active.shape[1])


@kernel
def detect_strands(
    memory: CapsuleMemory, pairs: ContactPairs, particles: FloatArray, sizes: tuple[FloatArray, float]
) -> None:
    """Append pairs of segments of one catheter; ``sizes`` is (radii of its segments, margin) in m."""
    for i in range(particles.shape[0] - 1):
        first = segment_at(particles, i)
        _detect_piece(memory, pairs, N_TOOL_PIECES + i, (first, sizes[0][i], 0.0), particles, sizes)


@kernel
def detect_spheres(
    memory: CapsuleMemory,
    pairs: ContactPairs,
    spheres: Spheres,
    count: int,
    particles: FloatArray,
    sizes: tuple[FloatArray, float],
) -> None:
    """Append pairs of the first ``count`` spheres with segments of the catheter; ``sizes`` as for strands.

    The margin grows by a sphere's motion in the step: a stone released by a tool meets the catheter at more than 1 m/s.
    """
    for k in range(count):
        centre, motion = row(spheres[0], k), row(spheres[1], k)
        first = (centre, centre), spheres[2][k], math.sqrt(dot(motion, motion))
        _detect_piece(memory, pairs, N_TOOL_PIECES + particles.shape[0] - 1 + k, first, particles, sizes)


@kernel
def _detect_piece(
    memory: CapsuleMemory,
    pairs: ContactPairs,
    p: int,
    first: tuple[Segment, float, float],
    particles: FloatArray,
    sizes: tuple[FloatArray, float],
) -> None:
    """Append pairs of piece p, whose segment, radius and motion are ``first``, with segments of the catheter."""
    segment, radius, moved_m = first
    margin = sizes[1] + moved_m
    for j in range(first_target(memory, p), memory.active.shape[1]):
        second, apart_m = segment_at(particles, j), radius + sizes[0][j]
        reach = apart_m + max(margin, LOOK_AHEAD_M + moved_m)
        if boxes_are_apart(segment, second, reach):
            memory.active[p, j] = 0
            continue
        s, t, distance, normal = track_pair(memory, (p, j), segment, second, (reach, apart_m, NO_END))
        if distance - apart_m < margin and not is_of_neighbour(memory, (p, j), s, t):
            tool, part, particle = owner_of(p)
            pair = (tool, part, particle, CATHETER_SEGMENT, j, s, (1.0 - t, t, 0.0))
            write_pair(pairs, pair, distance - apart_m, normal)


@kernel
def self_clearance_m(particles: FloatArray, n_apart: int, thickness: float) -> float:
    """Return a lower bound (m) on the gap between any two segments at least ``n_apart`` apart."""
    least = math.inf
    for i in range(particles.shape[0] - 1):
        first = segment_at(particles, i)
        for j in range(i + n_apart, particles.shape[0] - 1):
            half, middles_2 = _halves_and_middles(first, segment_at(particles, j))
            least = min(least, 0.5 * math.sqrt(middles_2) - half - thickness)
    return least


@kernel
def _halves_and_middles(first: Segment, second: Segment) -> tuple[float, float]:
    """Return the sum of half of both lengths, and four times the squared distance of the midpoints."""
    (a, b), (c, d) = first, second
    half = 0.5 * (math.sqrt(squared_distance(a, b)) + math.sqrt(squared_distance(c, d)))
    return half, squared_distance(along(a, b, 1.0), along(c, d, 1.0))
