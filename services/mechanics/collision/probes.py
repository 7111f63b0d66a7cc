"""Probes that follow the wall from tick to tick: particles of the catheter, pieces of an instrument's axis.

Each probe keeps up to two local minima of its distance to the wall and walks them over the mesh. That is all
the work there is, until probe and wall together have moved by the slack of the last search of the tree. A search
looks further than a contact reaches, by a skin: until this slack is used up nothing that it did not see can
have come within reach (a Verlet list, kept for minima instead of pairs). How much is used up is first a sum of all
motion, then, where that is too much, what `regions` knows of where the wall is. New mesh, jump or lost minimum: the
slack is gone and the tree answers.
"""

from __future__ import annotations

import math
from typing import Annotated, Self

import numpy as np

from services.mechanics.arrays import ByteArray, FloatArray, IntArray, LongArray
from services.mechanics.collision.aabb_distance import OPPOSITE
from services.mechanics.collision.nodes import corner_positions
from services.mechanics.collision.primitives import index
from services.mechanics.collision.regions import Near, note_near, used_since
from services.mechanics.collision.search import (
    NOT_FOUND,
    Touch,
    closest,
    closest_opposite,
    distance_to_all,
    offset,
    walk,
)
from services.mechanics.collision.shell import Body, Patch
from services.mechanics.collision.sides import UNKNOWN, Contact, Past, contact_followed
from services.mechanics.compiled import inlined_kernel, kernel
from services.mechanics.compiled.struct import Struct
from services.mechanics.compiled.vectors import (
    Vector,
    along,
    combine,
    dot,
    put_row_of,
    row_of,
    scaled,
    squared_distance,
    subtract,
    unit,
)

MINIMA = 2
# The second minimum is given up when the walls no longer face each other; later than it is taken up.
STILL_OPPOSITE = OPPOSITE + 0.25
SKIN_M = 1e-3
# A longer jump in one tick is not motion: 20 m/s.
JUMP_M = 20e-3
ROOM_M = 1e3
# Who has used this part of its slack may search ahead of need, so that probes that move together do not all search
# together. Each search of a tick halves what the next may have left.
EARLY = 0.5
_NEW = 2  # no side


class Probes(Struct):
    """State of n probes; everything a tick leaves for the next."""

    near: Near
    ends: Annotated[FloatArray, "n", 2, 3]  # at the last tick
    search: Annotated[LongArray, "n"]  # number of the last search
    looked_at: Annotated[FloatArray, "n", 2, 3]  # ends when it was last known how much of the slack is left
    used: Annotated[FloatArray, "n"]  # how much of it was used up then
    travel: Annotated[FloatArray, "n"]  # the wall's travel then
    seen: Annotated[FloatArray, "n"]  # distance out to which the last search looked; negative without a past
    triangle: Annotated[IntArray, "n", MINIMA]  # of each minimum, or NOT_FOUND
    side: Annotated[ByteArray, "n", MINIMA]  # of the wall at each minimum
    parameter: Annotated[FloatArray, "n", MINIMA]  # s on the probe
    weights: Annotated[FloatArray, "n", MINIMA, 3]  # barycentric
    point: Annotated[FloatArray, "n", MINIMA, 3]  # of the wall, where it was then
    normal: Annotated[FloatArray, "n", MINIMA, 3]  # towards the probe
    distance: Annotated[FloatArray, "n", MINIMA]  # signed, from the mid-surface to the axis
    is_aside: bool = False  # whether this tick's searches will be forgotten
    leeway_m: float = math.inf  # no probe that is advanced has more slack than this
    due: float = EARLY  # part of its slack from which a probe searches, in this tick

    @classmethod
    def allocate(cls, n: int, n_modes: int = 0) -> Self:
        """Return n probes without a past, on a wall of so many modes; with 0 they have no second opinion."""
        near = Near.allocate(n, n_modes)
        return cls.zeros(n=n, near=near, seen=np.full(n, -1.0), triangle=np.full((n, MINIMA), NOT_FOUND, np.int32))

    def reset(self, which: slice = slice(None)) -> None:
        """Drop the past of ``which`` probes."""
        self.seen[which] = -1.0


@kernel
def forget(probes: Probes, i: int) -> None:
    """Drop the past of one probe."""
    probes.seen[i] = -1.0
    for k in range(MINIMA):
        probes.triangle[i, k] = NOT_FOUND
        probes.side[i, k] = UNKNOWN


@kernel
def motion_to(probes: Probes, i: int, p: Vector) -> Vector:
    """Return how far probe i, a point, has come since the last tick if it is at p now; zero without a past."""
    motion = subtract(p, row_of(probes.ends, i, 0))
    if probes.seen[i] < 0.0 or not dot(motion, motion) < JUMP_M * JUMP_M:
        return (0.0, 0.0, 0.0)
    return motion


@kernel
def wall_motion(body: Body, wall: Patch, probes: Probes, i: int, k: int) -> Vector:
    """Return how far the wall has come since the last tick where minimum k of probe i touched it; zero without one."""
    if probes.seen[i] < 0.0 or probes.triangle[i, k] == NOT_FOUND:
        return (0.0, 0.0, 0.0)
    p0, p1, p2 = corner_positions(body, wall, index(probes.triangle[i, k]))
    motion = subtract(combine(row_of(probes.weights, i, k), p0, p1, p2), row_of(probes.point, i, k))
    return motion if dot(motion, motion) < JUMP_M * JUMP_M else (0.0, 0.0, 0.0)


@kernel
def is_near(p: Vector) -> bool:
    """Return whether a point is in the room: no number that is not one, and none that overflows squared."""
    return max(abs(p[0]), abs(p[1]), abs(p[2])) < ROOM_M and p[0] == p[0] and p[1] == p[1] and p[2] == p[2]


@kernel
def advance(
    body: Body,
    wall: Patch,
    probes: Probes,
    i: int,
    ends: tuple[Vector, Vector],
    on_the_way: tuple[float, int],
    there: tuple[float, int],
) -> None:
    """Move probe i to ``ends`` in steps shorter than it reaches, so that it cannot pass the wall unseen.

    Both last arguments hold how far to look and the side of a newly found minimum, `UNKNOWN` to take the side on
    which the probe is.
    """
    reach = on_the_way[0]
    old_a, old_b = row_of(probes.ends, i, 0), row_of(probes.ends, i, 1)
    if not (is_near(ends[0]) and is_near(ends[1])):
        forget(probes, i)
        return
    motion = math.sqrt(max(squared_distance(ends[0], old_a), squared_distance(ends[1], old_b)))
    steps = 1
    if motion > JUMP_M or probes.seen[i] < 0.0:
        forget(probes, i)
    elif _used(body, probes, i, ends) >= probes.seen[i] - reach:
        steps += int(2.0 * motion / reach)
    for step in range(1, steps):
        part = step / steps
        a = along(scaled(old_a, 1.0 - part), ends[0], part)
        _update(body, wall, probes, i, (a, along(scaled(old_b, 1.0 - part), ends[1], part)), on_the_way)
    _update(body, wall, probes, i, ends, there)
    for end in range(2):
        put_row_of(probes.ends, i, end, ends[end])


@kernel
def _used(body: Body, probes: Probes, i: int, ends: tuple[Vector, Vector]) -> float:
    """Return how much of the slack motion since the last search has used up, by what it was and all motion since."""
    moved_a = squared_distance(ends[0], row_of(probes.looked_at, i, 0))
    moved_b = squared_distance(ends[1], row_of(probes.looked_at, i, 1))
    used: float = probes.used[i] + math.sqrt(max(moved_a, moved_b)) + body.travel - probes.travel[i]
    return used


@kernel
def _look(body: Body, probes: Probes, i: int, ends: tuple[Vector, Vector], used: float) -> None:
    """Note how much of the slack is used up, with probe and wall where they are now."""
    for end in range(2):
        put_row_of(probes.looked_at, i, end, ends[end])
    probes.used[i], probes.travel[i] = used, body.travel_noted


@kernel
def _update(
    body: Body, wall: Patch, probes: Probes, i: int, ends: tuple[Vector, Vector], reach_and_hint: tuple[float, int]
) -> None:
    reach = reach_and_hint[0]
    triangle = probes.triangle
    first = _follow(body, wall, triangle[i, 0], ends, reach)
    second = _follow(body, wall, triangle[i, 1], ends, reach)
    is_lost = first[0] == NOT_FOUND and triangle[i, 0] != NOT_FOUND
    if is_lost or _is_search_due(body, probes, i, ends, reach):
        _search(body, wall, probes, i, ends, (first, second), reach_and_hint)
        return
    if first[0] != NOT_FOUND:
        _store(body, wall, probes, i, 0, contact_followed(body, wall, first, ends, _past(probes, i, 0), reach))
    if second[0] != NOT_FOUND and _is_opposite(body, wall, first, second, ends):
        _store(body, wall, probes, i, 1, contact_followed(body, wall, second, ends, _past(probes, i, 1), reach))
    else:
        triangle[i, 1] = NOT_FOUND


@kernel
def _follow(body: Body, wall: Patch, triangle: int, ends: tuple[Vector, Vector], reach: float) -> Touch:
    if triangle == NOT_FOUND:
        return (index(NOT_FOUND), math.inf, 0.0, (1.0, 0.0, 0.0))
    return walk(body, wall, index(triangle), ends[0], ends[1], reach)


@inlined_kernel
def _is_search_due(body: Body, probes: Probes, i: int, ends: tuple[Vector, Vector], reach: float) -> bool:
    enough = probes.due * min(probes.seen[i] - reach, probes.leeway_m)
    if _used(body, probes, i, ends) < enough:
        return False
    used = used_since(body, probes.near, i, ends, probes.search[i])
    if used < enough:
        _look(body, probes, i, ends, used)
        return False
    probes.due = 0.5 * (1.0 + probes.due)
    return True


@kernel
def _is_opposite(body: Body, wall: Patch, first: Touch, second: Touch, ends: tuple[Vector, Vector]) -> bool:
    u = unit(offset(body, wall, first, ends[0], ends[1]))
    v = unit(offset(body, wall, second, ends[0], ends[1]))
    return dot(u, v) < STILL_OPPOSITE


@inlined_kernel
def _search(
    body: Body,
    wall: Patch,
    probes: Probes,
    i: int,
    ends: tuple[Vector, Vector],
    followed: tuple[Touch, Touch],
    reach_and_hint: tuple[float, int],
) -> None:
    """Find the minima anew; a minimum that is met again keeps its side, one that is pushed through is kept."""
    body.searches += 1
    a, b = ends
    reach, hint = reach_and_hint
    triangle = probes.triangle
    pasts = (_past(probes, i, 0), _past(probes, i, 1))
    first = followed[0]
    if first[0] == NOT_FOUND or contact_followed(body, wall, first, ends, pasts[0], reach)[2] >= 0.0:
        first = closest(body, wall, a, b, reach + SKIN_M, first[0])
    _note_seen(body, wall, probes, i, ends, first, reach)
    triangle[i, 0] = triangle[i, 1] = NOT_FOUND
    if first[0] == NOT_FOUND:
        return
    past = _past_of(first, followed, pasts, hint)
    _store(body, wall, probes, i, 0, contact_followed(body, wall, first, ends, past, reach))
    away = offset(body, wall, first, a, b)
    if dot(away, away) == 0.0:
        return
    second = closest_opposite(body, wall, a, b, reach + SKIN_M, scaled(unit(away), -1.0))
    for k in range(MINIMA):
        # What is followed is given up later than it is taken up, by a search as well.
        known = followed[k]
        is_nearer = known[0] != NOT_FOUND and known[1] < second[1]
        if is_nearer and known[0] != first[0] and _is_opposite(body, wall, first, known, ends):
            second = known
    if second[0] == NOT_FOUND:
        return
    past = _past_of(second, followed, pasts, index(_NEW))
    is_new = past[0] == _NEW
    contact = contact_followed(body, wall, second, ends, (hint if is_new else past[0], past[1], past[2]), reach)
    # Through a wall one sees the back of the opposite one, which nobody has been pushed through.
    if contact[2] >= 0.0 or hint == UNKNOWN or not is_new:
        _store(body, wall, probes, i, 1, contact)


@inlined_kernel
def _note_seen(
    body: Body, wall: Patch, probes: Probes, i: int, ends: tuple[Vector, Vector], first: Touch, reach: float
) -> None:
    """Note where the search was made and how far it has looked."""
    seen = probes.seen
    _look(body, probes, i, ends, 0.0)
    seen[i], probes.search[i] = reach + SKIN_M, body.searches
    if first[0] == NOT_FOUND:
        seen[i] = max(seen[i], distance_to_all(body, wall, ends[0], ends[1]))
    if not probes.is_aside:
        note_near(body, wall, probes.near, i, ends, seen[i])


@kernel
def _past_of(found: Touch, followed: tuple[Touch, Touch], pasts: tuple[Past, Past], hint: int) -> Past:
    """Return the past of the minimum that was found again, or one without a distance and with ``hint`` as its side."""
    for k in range(MINIMA):
        if followed[k][0] != NOT_FOUND and (
            found[0] == followed[k][0] or abs(found[1] - followed[k][1]) <= 1e-9 * found[1]
        ):
            return pasts[k]
    return (hint, pasts[0][1], 0.0)


@kernel
def _past(probes: Probes, i: int, k: int) -> Past:
    distance = probes.distance[i, k] if probes.triangle[i, k] != NOT_FOUND else 0.0
    return (index(probes.side[i, k]), row_of(probes.normal, i, k), distance)


@kernel
def _store(body: Body, wall: Patch, probes: Probes, i: int, k: int, contact: Contact) -> None:
    touch, normal, distance, side = contact
    p0, p1, p2 = corner_positions(body, wall, touch[0])
    put_row_of(probes.point, i, k, combine(touch[3], p0, p1, p2))
    probes.triangle[i, k] = touch[0]
    probes.side[i, k] = side
    probes.parameter[i, k] = touch[2]
    put_row_of(probes.weights, i, k, touch[3])
    put_row_of(probes.normal, i, k, normal)
    probes.distance[i, k] = distance
