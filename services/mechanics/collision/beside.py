"""What a piece of an instrument will touch beside the closest point of the wall, before anybody looks again.

Detection knows the closest point of each piece. Where that is pressed the wall gives way, and the instrument moves on
into what lies beside it: a fifth of a millimetre in a tick at 0.3 m/s. So the triangles round the closest point give
points of their own, as far as the segment would come to them by going on along the wall as in the last tick. That the
wall moves, and slides along a tool at rest, is the same. Slow ones need none: slow on the average of two ticks, for an
arm moves by counts of its encoders, and a hand that is told of in every other tick by twice as much or not at all.
"""

from __future__ import annotations

import math
from typing import Annotated

from services.mechanics.arrays import FloatArray, IntArray, LongArray
from services.mechanics.collision.primitives import clamp01
from services.mechanics.collision.probes import Probes, wall_motion
from services.mechanics.collision.shell import Body, Patch
from services.mechanics.collision.topology import NO_NEIGHBOUR
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Struct
from services.mechanics.compiled.vectors import (
    Vector,
    along,
    dot,
    put_row,
    row,
    scaled,
    squared_distance,
    subtract,
    unit,
)

# Points closer than this part of the distance between axis and mid-surface are one: on a flat wall nothing between two
# of them is deeper than both by more than a hundredth of it. Beside a dent it is, by ten times that.
APART = 0.125
# Nor deeper than this part of a thin wall, on which they may lie nearer to each other.
ALIKE_OF_WALL = 0.125
# A point seen from more than 60 degrees off the closest one's normal is on another side of the wall.
FACING = 0.5
# Who comes no nearer than this in a tick finds what it meets by the closest points alone, no later than that deep; one
# that begins to move by no more than twice as much, a tick later.
LEAST_M = 50e-6
# Nor than this part of a thin wall.
LEAST_OF_WALL = 0.25
# Who slides by no more than this in a tick rests on the wall, as far as it is no further off than that: such a piece
# has this slack only. Between points that it presses the wall may bulge, where no walk from them leads.
QUIET_M, NEARLY_M, BULGE_M = 10e-6, 20e-6, 0.2e-3
# What is no further than so many times what counts as close leads on to what is.
LEADS_ON = 4.0
# A wall that is dented rises so steeply beside what presses it, at most.
SLOPE = 1.0
MOST_POINTS, MOST_TRIANGLES = 48, 128


class Beside(Struct):
    """How p probes came to where they are, and the points of one segment's pairs."""

    motion: Annotated[FloatArray, "p", 3]  # of each probe's middle along the wall since the last tick
    closing: Annotated[FloatArray, "p"]  # how much nearer its closest point has come since then; less than 0: away
    last_motion: Annotated[FloatArray, "p", 3]  # both in the tick before
    last_closing: Annotated[FloatArray, "p"]
    point: Annotated[FloatArray, MOST_POINTS, 3]
    visited: Annotated[LongArray, "m"]  # the stamp under which each triangle was looked at last
    queue: Annotated[IntArray, MOST_TRIANGLES]  # triangles to look at, in the order in which they were met
    wall_m: float  # how thick the wall is
    close_m: float = 0.0  # what is nearer than this is met, whatever moves: more than nothing where a step has ended
    count: int = 0
    queued: int = 0
    stamp: int = 0


@kernel
def apart_m(thickness: float, wall_m: float) -> float:
    """Return how near to each other two points are one, ``thickness`` being the distance between axis and mid-surface.

    Between two points d apart a flat wall is d^2 / 8 r deep in a round tool.
    """
    return min(APART * thickness, math.sqrt(8.0 * ALIKE_OF_WALL * wall_m * thickness))


@kernel
def start_segment(beside: Beside) -> None:
    """Begin a segment, without points, and with all triangles still to be looked at."""
    beside.count = 0
    beside.stamp += 1


@kernel
def start_round(beside: Beside, triangle: int) -> None:
    """Begin to look round a triangle."""
    beside.queue[0] = triangle
    beside.queued = 1
    beside.visited[triangle] = beside.stamp


@kernel
def go_to(beside: Beside, triangle: int) -> None:
    """Look at a triangle later, unless it is none, or was looked at for this segment."""
    if triangle == NO_NEIGHBOUR or beside.visited[triangle] == beside.stamp or beside.queued == MOST_TRIANGLES:
        return
    beside.visited[triangle] = beside.stamp
    beside.queue[beside.queued] = triangle
    beside.queued += 1


@kernel
def note_before(body: Body, wall: Patch, beside: Beside, probes: Probes, i: int, ends: tuple[Vector, Vector]) -> None:
    """Note the motion of probe i to ``ends`` against what it touched, and its distance: before it is advanced."""
    beside.last_closing[i] = beside.closing[i]
    beside.closing[i] = math.inf
    wall_went = wall_motion(body, wall, probes, i, 0)
    for axis in range(3):
        beside.last_motion[i, axis] = beside.motion[i, axis]
        beside.motion[i, axis] = 0.0
        if probes.seen[i] >= 0.0:
            middle = 0.5 * (ends[0][axis] + ends[1][axis])
            went = middle - 0.5 * (probes.ends[i, 0, axis] + probes.ends[i, 1, axis])
            beside.motion[i, axis] = went - wall_went[axis]
    if probes.seen[i] >= 0.0 and probes.triangle[i, 0] >= 0:
        beside.closing[i] = probes.distance[i, 0]


@kernel
def note_after(beside: Beside, probes: Probes, i: int) -> None:
    """Make the distance noted into what the closest point of probe i has come nearer."""
    before = beside.closing[i]
    is_known = before < math.inf and probes.triangle[i, 0] >= 0
    beside.closing[i] = before - probes.distance[i, 0] if is_known else 0.0


@kernel
def comes_nearer(beside: Beside, i: int) -> bool:
    """Return whether probe i moves so much, or the wall towards it, that it will meet more than its closest point."""
    motion, last, closing = row(beside.motion, i), row(beside.last_motion, i), beside.closing[i]
    least = min(LEAST_M, LEAST_OF_WALL * beside.wall_m)
    if beside.close_m > 0.0 or max(math.sqrt(dot(motion, motion)), closing) > 2.0 * least:
        return True
    both = along(motion, last, 1.0)
    return bool(max(math.sqrt(dot(both, both)), closing + beside.last_closing[i]) > 2.0 * least)


@kernel
def hardly_slides(beside: Beside, i: int) -> bool:
    """Return whether probe i moves so little against what it touched that nobody looks at what is beside that."""
    motion = row(beside.motion, i)
    return bool(dot(motion, motion) < QUIET_M * QUIET_M)


@kernel
def is_met(beside: Beside, i: int, facing: Vector, contact: tuple[float, Vector]) -> bool:
    """Return whether a point with this gap and normal will be met by probe i, whose closest one has normal ``facing``.

    As far as room for points is left.
    """
    gap, normal = contact
    motion = row(beside.motion, i)
    nearer = max(-dot(motion, normal), SLOPE * math.sqrt(dot(motion, motion)), beside.closing[i])
    nearer = max(nearer, LEADS_ON * beside.close_m)
    return bool(gap < nearer and dot(normal, facing) > FACING and beside.count < MOST_POINTS)


@kernel
def place_along(point: Vector, ends: tuple[Vector, Vector]) -> float:
    """Return where on the axis between ``ends`` is closest to a point, 0 to 1."""
    axis = subtract(ends[1], ends[0])
    length_2 = dot(axis, axis)
    return clamp01(dot(subtract(point, ends[0]), axis) / length_2) if length_2 > 0.0 else 0.0


@kernel
def seen_from(point: Vector, ends: tuple[Vector, Vector]) -> tuple[float, float, Vector]:
    """Return the place on an axis that is closest to a point, its distance, and the unit vector from there to it."""
    s = place_along(point, ends)
    away = subtract(along(scaled(ends[0], 1.0 - s), ends[1], s), point)
    distance = math.sqrt(dot(away, away))
    return s, distance, unit(away)


@kernel
def take_point(beside: Beside, point: Vector, apart: float) -> bool:
    """Add a point of the wall to those of the segment, unless there is one closer than ``apart``."""
    for k in range(beside.count):
        if squared_distance(row(beside.point, k), point) < apart * apart:
            return False
    if beside.count < MOST_POINTS:
        put_row(beside.point, beside.count, point)
        beside.count += 1
    return True
