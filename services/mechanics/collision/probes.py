"""Probes that follow the wall from tick to tick: particles of the catheter, pieces of an instrument's axis.

Each probe keeps up to two local minima of its distance to the wall and walks them over the mesh. That is all
the work there is, until probe and wall together have moved by the slack of the last search of the tree. A search
looks further than a contact reaches, by a skin: until the slack is used up nothing that it did not see can
have come within reach (a Verlet list, kept for minima instead of pairs). New mesh, jump or lost minimum: the
slack is zero and the tree answers.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from services.mechanics.collision.kernel import kernel
from services.mechanics.collision.primitives import Vector, along, dot, scaled, squared_distance, subtract, unit
from services.mechanics.collision.search import (
    APART,
    NOTHING,
    Touch,
    closest,
    closest_apart,
    distance_to_all,
    offset,
    walk,
)
from services.mechanics.collision.sides import UNKNOWN, Contact, settle
from services.mechanics.collision.surface import SEARCHES, TRAVEL, Body, Patch
from services.mechanics.mesh import FloatArray, IntArray

MINIMA = 2
SKIN_M = 1e-3
# A longer jump in one tick is not motion: 20 m/s.
JUMP_M = 20e-3
# Searches done ahead of need in a tick, so that probes that move together do not all search together.
EARLY_SEARCHES = 4


class Probes(NamedTuple):
    """State of n probes; everything a tick leaves for the next."""

    ends: FloatArray
    """(n, 2, 3) ends at the last tick."""
    searched_at: FloatArray
    """(n, 2, 3) ends at the last search."""
    travel: FloatArray
    """(n,) the wall's travel at the last search."""
    slack: FloatArray
    """(n,) motion of probe and wall after which to search again; negative if the probe has no past."""
    triangle: IntArray
    """(n, 2) triangle of each minimum or `NOTHING`."""
    side: npt.NDArray[np.int8]
    """(n, 2) side of the wall at each minimum."""
    place: FloatArray
    """(n, 2, 4) s on the probe and barycentric weights."""
    normal: FloatArray
    """(n, 2, 3) towards the probe."""
    distance: FloatArray
    """(n, 2) signed distance from the mid-surface to the axis."""
    early: IntArray
    """(1,) searches that may still be done ahead of need in this tick."""


def make_probes(n: int) -> Probes:
    """Return n probes without a past."""
    return Probes(
        ends=np.zeros((n, 2, 3)),
        searched_at=np.zeros((n, 2, 3)),
        travel=np.zeros(n),
        slack=np.full(n, -1.0),
        triangle=np.full((n, MINIMA), NOTHING, np.int32),
        side=np.zeros((n, MINIMA), np.int8),
        place=np.zeros((n, MINIMA, 4)),
        normal=np.zeros((n, MINIMA, 3)),
        distance=np.zeros((n, MINIMA)),
        early=np.zeros(1, np.int32),
    )


@kernel
def forget(probes: Probes, i: int) -> None:
    """Drop the past of one probe."""
    probes.slack[i] = -1.0
    for k in range(MINIMA):
        probes.triangle[i, k] = NOTHING
        probes.side[i, k] = UNKNOWN


@kernel
def end_of(ends: FloatArray, i: int, k: int) -> Vector:
    """Return row (i, k) of an array of ends."""
    return (ends[i, k, 0], ends[i, k, 1], ends[i, k, 2])


@kernel
def advance(body: Body, wall: Patch, probes: Probes, i: int, a: Vector, b: Vector, reach: float, hint: int) -> None:
    """Move probe i to ab in steps shorter than it reaches, so that it cannot pass the wall unseen.

    ``hint`` is the side of a newly found minimum, `UNKNOWN` to take the side on which the probe is.
    """
    from_a, from_b = end_of(probes.ends, i, 0), end_of(probes.ends, i, 1)
    motion = math.sqrt(max(squared_distance(a, from_a), squared_distance(b, from_b)))
    if math.isnan(motion):
        forget(probes, i)
        return
    if motion > JUMP_M or probes.slack[i] < 0.0:
        forget(probes, i)
        steps = 1
    else:
        steps = 1 + int(2.0 * motion / reach) if _used(body, probes, i, a, b) >= probes.slack[i] else 1
    for step in range(1, steps + 1):
        part = step / steps
        here_a = along(scaled(from_a, 1.0 - part), a, part) if step < steps else a
        here_b = along(scaled(from_b, 1.0 - part), b, part) if step < steps else b
        _update(body, wall, probes, i, here_a, here_b, reach, hint)
    for axis in range(3):
        probes.ends[i, 0, axis], probes.ends[i, 1, axis] = a[axis], b[axis]


@kernel
def _used(body: Body, probes: Probes, i: int, a: Vector, b: Vector) -> float:
    """Return how much of the slack motion since the last search has used up."""
    moved_a = squared_distance(a, end_of(probes.searched_at, i, 0))
    moved_b = squared_distance(b, end_of(probes.searched_at, i, 1))
    return math.sqrt(max(moved_a, moved_b)) + body.measure[TRAVEL] - probes.travel[i]


@kernel
def _update(body: Body, wall: Patch, probes: Probes, i: int, a: Vector, b: Vector, reach: float, hint: int) -> None:
    first = _follow(body, wall, probes.triangle[i, 0], a, b)
    second = _follow(body, wall, probes.triangle[i, 1], a, b)
    if first[0] == NOTHING and probes.triangle[i, 0] != NOTHING or _is_search_due(body, probes, i, a, b):
        _search(body, wall, probes, i, (a, b), (first, second), reach, hint)
        return
    if first[0] != NOTHING:
        _store(probes, i, 0, settle(body, wall, first, a, b, probes.side[i, 0]))
    if second[0] != NOTHING and _is_apart(body, wall, first, second, a, b):
        _store(probes, i, 1, settle(body, wall, second, a, b, probes.side[i, 1]))
    else:
        probes.triangle[i, 1] = NOTHING


@kernel
def _follow(body: Body, wall: Patch, triangle: int, a: Vector, b: Vector) -> Touch:
    if triangle == NOTHING:
        return (NOTHING, math.inf, 0.0, (1.0, 0.0, 0.0))
    return walk(body, wall, triangle, a, b)


@kernel
def _is_search_due(body: Body, probes: Probes, i: int, a: Vector, b: Vector) -> bool:
    used = _used(body, probes, i, a, b)
    if not used < probes.slack[i]:
        return True
    if used > 0.5 * probes.slack[i] and probes.early[0] > 0:
        probes.early[0] -= 1
        return True
    return False


@kernel
def _is_apart(body: Body, wall: Patch, first: Touch, second: Touch, a: Vector, b: Vector) -> bool:
    u = unit(offset(body, wall, first, a, b))
    v = unit(offset(body, wall, second, a, b))
    return dot(u, v) < APART


@kernel
def _search(
    body: Body,
    wall: Patch,
    probes: Probes,
    i: int,
    ends: tuple[Vector, Vector],
    followed: tuple[Touch, Touch],
    reach: float,
    hint: int,
) -> None:
    """Find the minima anew; a minimum that is met again keeps its side, one that is pushed through is kept."""
    body.count[SEARCHES] += 1
    a, b = ends
    first, side = followed[0], int(probes.side[i, 0])
    old_sides = (side, int(probes.side[i, 1]))
    if first[0] == NOTHING or settle(body, wall, first, a, b, side)[2] >= 0.0:
        first = closest(body, wall, a, b, reach + SKIN_M, first[0])
        side = _remembered_side(first, followed, old_sides, hint)
    _start_slack(body, wall, probes, i, ends, first, reach)
    probes.triangle[i, 0] = probes.triangle[i, 1] = NOTHING
    if first[0] == NOTHING or probes.slack[i] > SKIN_M:
        return
    _store(probes, i, 0, settle(body, wall, first, a, b, side))
    away = offset(body, wall, first, a, b)
    if dot(away, away) == 0.0:
        return
    second = closest_apart(body, wall, a, b, reach + SKIN_M, scaled(unit(away), -1.0))
    if second[0] != NOTHING:
        side = _remembered_side(second, followed, old_sides, hint)
        _store(probes, i, 1, settle(body, wall, second, a, b, side))


@kernel
def _start_slack(
    body: Body, wall: Patch, probes: Probes, i: int, ends: tuple[Vector, Vector], first: Touch, reach: float
) -> None:
    """Note where the search was made and how far probe and wall may move until the next."""
    for k in range(2):
        for axis in range(3):
            probes.searched_at[i, k, axis] = ends[k][axis]
    probes.travel[i] = body.measure[TRAVEL]
    probes.slack[i] = SKIN_M
    if first[0] == NOTHING:
        probes.slack[i] = max(SKIN_M, distance_to_all(body, wall, ends[0], ends[1]) - reach)


@kernel
def _remembered_side(found: Touch, followed: tuple[Touch, Touch], sides: tuple[int, int], hint: int) -> int:
    for k in range(MINIMA):
        if followed[k][0] != NOTHING and (
            found[0] == followed[k][0] or abs(found[1] - followed[k][1]) <= 1e-9 * found[1]
        ):
            return sides[k]
    return hint


@kernel
def _store(probes: Probes, i: int, k: int, contact: Contact) -> None:
    touch, normal, distance, side = contact
    probes.triangle[i, k] = touch[0]
    probes.side[i, k] = side
    probes.place[i, k, 0] = touch[2]
    for axis in range(3):
        probes.place[i, k, 1 + axis] = touch[3][axis]
        probes.normal[i, k, axis] = normal[axis]
    probes.distance[i, k] = distance
