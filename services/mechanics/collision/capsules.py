"""Capsule against capsule: segments of tools against segments of the catheter, and the catheter against itself.

Each pair of segments within reach remembers its normal. When the axes have passed through each other the new
normal points against the old one: the old one stands and the distance counts negative, so that nothing slips
through. Around a free end the normal may turn all the way.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from services.mechanics.collision.kernel import kernel
from services.mechanics.collision.primitives import (
    Vector,
    along,
    closest_of_segments,
    cross,
    dot,
    scaled,
    squared_distance,
    subtract,
    unit,
)
from services.mechanics.collision.probes import end_of
from services.mechanics.collision.writer import FULL, PairRows, take_row
from services.mechanics.contact.pairs import CATHETER_SEGMENT, SHAFT
from services.mechanics.mesh import FloatArray, IntArray

# Contacts per tool segment: the deepest in each of so many equal stretches of it.
STRETCHES = 6
_TOUCHING_M = 1e-9
NONE = -1


class CapsulePairs(NamedTuple):
    """Memory of m first segments against n second ones."""

    active: npt.NDArray[np.int8]
    """(m, n) one where the pair was within reach at the last tick."""
    normal: FloatArray
    """(m, n, 3) towards the first body, of active pairs."""
    best: IntArray
    """(STRETCHES,) second segment of the deepest contact in each stretch of the first, or `NONE`."""
    found: FloatArray
    """(STRETCHES, 6) its s, t, distance and normal."""


def make_capsule_pairs(m: int, n: int) -> CapsulePairs:
    """Return pairs without a past."""
    return CapsulePairs(
        np.zeros((m, n), np.int8), np.zeros((m, n, 3)), np.zeros(STRETCHES, np.int32), np.zeros((STRETCHES, 6))
    )


@kernel
def meet(
    pairs: CapsulePairs, i: int, j: int, first: tuple[Vector, Vector], second: tuple[Vector, Vector], reach: float
) -> tuple[float, float, float, Vector]:
    """Return (s, t, signed distance of the axes, normal towards the first) and remember the normal.

    The distance is infinite out of reach.
    """
    s, t, d2 = closest_of_segments(first[0], first[1], second[0], second[1])
    if not d2 < reach * reach:
        pairs.active[i, j] = 0
        return (s, t, math.inf, (0.0, 0.0, 0.0))
    distance = math.sqrt(d2)
    u, v = subtract(first[1], first[0]), subtract(second[1], second[0])
    away = subtract(along(first[0], u, s), along(second[0], v, t))
    old = (pairs.normal[i, j, 0], pairs.normal[i, j, 1], pairs.normal[i, j, 2])
    was_active = pairs.active[i, j] == 1
    if distance > _TOUCHING_M:
        normal = scaled(away, 1.0 / distance)
    else:
        normal = old if was_active else unit(cross(u, v))
    if was_active and 0.0 < s < 1.0 and dot(normal, old) < 0.0:
        normal, distance = scaled(normal, -1.0), -distance
    pairs.active[i, j] = 1
    for axis in range(3):
        pairs.normal[i, j, axis] = normal[axis]
    return (s, t, distance, normal)


@kernel
def detect_capsules(
    pairs: CapsulePairs,
    tools: tuple[FloatArray, FloatArray, npt.NDArray[np.bool_]],
    particles: FloatArray,
    sizes: tuple[float, float, float],
    rows: PairRows,
) -> None:
    """Append pairs of tool segments with catheter segments; ``sizes`` holds (-, catheter radius, margin)."""
    segments, radii, present = tools
    for tool in range(segments.shape[0]):
        for segment in range(segments.shape[1]):
            i = tool * segments.shape[1] + segment
            if not present[tool]:
                for j in range(pairs.active.shape[1]):
                    pairs.active[i, j] = 0
                continue
            ends = (end_of(segments[tool], segment, 0), end_of(segments[tool], segment, 1))
            thickness = radii[tool, segment] + sizes[1]
            _find_deepest(pairs, i, ends, particles, thickness + sizes[2])
            _write_deepest(pairs, (tool, segment), (thickness, sizes[2]), rows)


@kernel
def _find_deepest(
    pairs: CapsulePairs, i: int, ends: tuple[Vector, Vector], particles: FloatArray, reach: float
) -> None:
    """Find the deepest contact of segment i in each of its stretches."""
    for stretch in range(STRETCHES):
        pairs.best[stretch] = NONE
    for j in range(pairs.active.shape[1]):
        c = (particles[j, 0], particles[j, 1], particles[j, 2])
        d = (particles[j + 1, 0], particles[j + 1, 1], particles[j + 1, 2])
        s, t, distance, normal = meet(pairs, i, j, ends, (c, d), reach)
        stretch = min(int(s * STRETCHES), STRETCHES - 1)
        if distance == math.inf or (pairs.best[stretch] != NONE and pairs.found[stretch, 2] <= distance):
            continue
        pairs.best[stretch] = j
        pairs.found[stretch, 0], pairs.found[stretch, 1], pairs.found[stretch, 2] = s, t, distance
        for axis in range(3):
            pairs.found[stretch, 3 + axis] = normal[axis]


@kernel
def _write_deepest(pairs: CapsulePairs, who: tuple[int, int], sizes: tuple[float, float], rows: PairRows) -> None:
    for stretch in range(STRETCHES):
        gap = pairs.found[stretch, 2] - sizes[0]
        if pairs.best[stretch] == NONE or not gap < sizes[1]:
            continue
        found = pairs.found
        row = take_row(rows, gap, (found[stretch, 3], found[stretch, 4], found[stretch, 5]))
        if row == FULL:
            continue
        rows.tool[row], rows.tool_segment[row] = who
        rows.particle[row] = -1
        rows.target_kind[row] = CATHETER_SEGMENT
        rows.target[row] = pairs.best[stretch]
        rows.tool_parameter[row] = found[stretch, 0]
        rows.target_weights[row, 0] = 1.0 - found[stretch, 1]
        rows.target_weights[row, 1] = found[stretch, 1]
        rows.target_weights[row, 2] = 0.0
