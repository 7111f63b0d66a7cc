"""On which side of the wall a probe is, and what that makes of the distance and the normal.

The side is remembered, not computed: a probe that has been pushed through the middle of the wall is still on
the side it came from, its distance is negative and its normal points back. At an open rim there are no sides:
the wall ends in a round edge, and a probe may pass around it.

Which side of the surface a point is on is read off the pseudo-normal, and that is right while the surface does not
cross itself. Jaws turn a fold inside out: at its edge the two normals then point inwards, and a probe two millimetres
off would be told to be as deep in the wall. Nobody passes a wall without its offset from it turning round, so a
minimum that is followed is beyond the wall only if its offset points against the normal that it had. Nor does anybody
pass a wall from further away than it is thick: a minimum that slid to another flank of the fold, millimetres off, is on
the side of that flank on which it is.
"""

from __future__ import annotations

import math

from services.mechanics.collision.nodes import corner_positions
from services.mechanics.collision.primitives import index
from services.mechanics.collision.search import NOT_FOUND, Touch, offset, walk
from services.mechanics.collision.shell import Body, Patch
from services.mechanics.collision.topology import NO_NEIGHBOUR
from services.mechanics.compiled import inlined_kernel, kernel
from services.mechanics.compiled.vectors import Vector, along, combine, cross, dot, scaled, subtract, unit

INSIDE, UNKNOWN, OUTSIDE = -1, 0, 1
# Below this distance from an edge or corner its direction is rounding; the surface normal stands in.
TOUCHING_M = 1e-9
# An offset less than 60 degrees off the normal of the last tick is still on the same side.
STILL = 0.5

Contact = tuple[Touch, Vector, float, int]
"""(touch, unit normal towards the probe, signed distance from the mid-surface to the probe's axis, side)."""

Past = tuple[int, Vector, float]
"""(side, normal, distance) of the contact that a minimum was in the last tick; without one the distance is 0."""


@kernel
def triangle_normal(body: Body, patch: Patch, triangle: int) -> Vector:
    """Return the outward unit normal of a deformed triangle."""
    p0, p1, p2 = corner_positions(body, patch, triangle)
    return unit(cross(subtract(p1, p0), subtract(p2, p0)))


@kernel
def surface_normal(body: Body, patch: Patch, touch: Touch) -> Vector:
    """Return the outward pseudo-normal of the feature touched: triangle, edge or corner.

    Its sign against the offset tells the side of a closed surface exactly (Baerentzen and Aanaes, "Signed
    distance computation using the angle weighted pseudonormal", 2005).
    """
    triangle, w = touch[0], touch[3]
    for corner in range(3):
        if w[corner] == 1.0:
            return _corner_normal(body, patch, patch.triangles[triangle, corner])
    normal = triangle_normal(body, patch, triangle)
    for edge in range(3):
        other = patch.neighbour[triangle, edge]
        if w[(edge + 2) % 3] == 0.0 and other != NO_NEIGHBOUR:
            return unit(along(normal, triangle_normal(body, patch, other), 1.0))
    return normal


@kernel
def _corner_normal(body: Body, patch: Patch, vertex: int) -> Vector:
    """Return the mean of the normals round a vertex, weighted by the angle of each triangle there."""
    total = (0.0, 0.0, 0.0)
    start, ring, corner = patch.ring_start, patch.ring, patch.triangles
    for k in range(start[vertex], start[vertex + 1]):
        triangle = ring[k]
        p0, p1, p2 = corner_positions(body, patch, triangle)
        if corner[triangle, 1] == vertex:
            p0, p1, p2 = p1, p2, p0
        elif corner[triangle, 2] == vertex:
            p0, p1, p2 = p2, p0, p1
        u, v = subtract(p1, p0), subtract(p2, p0)
        n = cross(u, v)
        doubled_area = math.sqrt(dot(n, n))
        if doubled_area > 0.0:
            total = along(total, n, math.atan2(doubled_area, dot(u, v)) / doubled_area)
    return unit(total)


@kernel
def is_on_rim(patch: Patch, touch: Touch) -> bool:
    """Return whether the feature touched is an edge or corner of an open rim."""
    triangle, w = touch[0], touch[3]
    for corner in range(3):
        if w[corner] == 1.0:
            return bool(patch.on_rim[patch.triangles[triangle, corner]] != 0)
    for edge in range(3):
        is_touched = w[(edge + 2) % 3] == 0.0
        if is_touched and patch.neighbour[triangle, edge] == NO_NEIGHBOUR:
            return True
    return False


@kernel
def contact_of(body: Body, patch: Patch, touch: Touch, a: Vector, b: Vector, side: int) -> Contact:
    """Turn a touch into a contact for a probe that is on ``side``; `UNKNOWN` takes the side it is found on."""
    away = offset(body, patch, touch, a, b)
    distance = math.sqrt(dot(away, away))
    if is_on_rim(patch, touch):
        if distance > TOUCHING_M:
            return (touch, scaled(away, 1.0 / distance), distance, UNKNOWN)
        return (touch, surface_normal(body, patch, touch), distance, UNKNOWN)
    normal = surface_normal(body, patch, touch)
    height = dot(away, normal)
    if side == UNKNOWN:
        # An axis that pierces the wall came from the side of its start.
        start = height if touch[1] > 0.0 else dot(_above(body, patch, touch, a), normal)
        side = OUTSIDE if start >= 0.0 else INSIDE
    if a != b and (touch[1] == 0.0 or side * height < 0.0):
        return _contact_at_deepest_end(body, patch, touch, a, b, side)
    return _contact_on_side(touch, away, distance, normal, side)


@kernel
def contact_followed(
    body: Body, patch: Patch, touch: Touch, ends: tuple[Vector, Vector], past: Past, reach: float
) -> Contact:
    """Turn a touch into a contact as `contact_of`, of a probe with this past at the minimum that it touches.

    Nobody goes through the wall by more than ``reach`` in a tick.
    """
    side, normal, distance = past
    contact = contact_of(body, patch, touch, ends[0], ends[1], side)
    if contact[2] >= 0.0 or distance <= 0.0 or touch[1] < TOUCHING_M * TOUCHING_M:
        return contact
    away, apart = offset(body, patch, touch, ends[0], ends[1]), math.sqrt(touch[1])
    if dot(away, normal) > STILL * apart or distance + apart > reach:
        return contact_of(body, patch, touch, ends[0], ends[1], index(UNKNOWN))
    return contact


@kernel
def _above(body: Body, patch: Patch, touch: Touch, p: Vector) -> Vector:
    """Return the vector from the touched point of the surface to p."""
    p0, p1, p2 = corner_positions(body, patch, touch[0])
    return subtract(p, combine(touch[3], p0, p1, p2))


@kernel
def _contact_on_side(touch: Touch, away: Vector, distance: float, normal: Vector, side: int) -> Contact:
    w = touch[3]
    height = dot(away, normal)
    inside_triangle = w[0] > 0.0 and w[1] > 0.0 and w[2] > 0.0
    if inside_triangle or distance < TOUCHING_M:
        return (touch, scaled(normal, float(side)), side * height, side)
    sign = 1.0 if side * height >= 0.0 else -1.0
    return (touch, scaled(away, sign / distance), sign * distance, side)


@inlined_kernel
def _contact_at_deepest_end(body: Body, patch: Patch, touch: Touch, a: Vector, b: Vector, side: int) -> Contact:
    """Measure an axis that has crossed the wall at whichever end is deeper beyond it."""
    normal = surface_normal(body, patch, touch)
    from_a = dot(_above(body, patch, touch, a), normal)
    from_b = dot(_above(body, patch, touch, b), normal)
    end, s = (a, 0.0) if side * from_a < side * from_b else (b, 1.0)
    found = walk(body, patch, index(touch[0]), end, end, math.inf)
    if found[0] == NOT_FOUND:
        return (touch, scaled(normal, float(side)), 0.0, side)
    there: Touch = (found[0], found[1], s, found[3])
    away = offset(body, patch, there, a, b)
    return _contact_on_side(there, away, math.sqrt(dot(away, away)), surface_normal(body, patch, there), side)
