"""Closest triangle of a deforming patch to a short segment: by AABB tree from nothing, by walking from a guess.

A *probe* is a segment a -> b; a particle is a probe with a == b. A *touch* is where probe and surface come
closest: (triangle, squared distance, s on the probe, barycentric weights).
"""

from __future__ import annotations

import math

from services.mechanics.collision.aabb_distance import OPPOSITE, distance2_below, join_children
from services.mechanics.collision.boxes import CHILD, CHILD_RIGHT, is_leaf
from services.mechanics.collision.nodes import corner_positions
from services.mechanics.collision.primitives import closest_on_triangle, closest_segment_triangle, index
from services.mechanics.collision.shell import Body, Patch
from services.mechanics.collision.topology import NO_NEIGHBOUR
from services.mechanics.compiled import inlined_kernel, kernel
from services.mechanics.compiled.vectors import Vector, along, combine, dot, scaled, squared_distance, subtract

Touch = tuple[int, float, float, Vector]
NOT_FOUND = -1
WALK_LIMIT = 256


@kernel
def touch_triangle(body: Body, patch: Patch, triangle: int, a: Vector, b: Vector) -> Touch:
    """Return the touch of probe ab on one triangle."""
    body.triangle_tests += 1
    triangle = index(triangle)
    p0, p1, p2 = corner_positions(body, patch, triangle)
    if a == b:
        w = closest_on_triangle(a, p0, p1, p2)
        return (triangle, squared_distance(a, combine(w, p0, p1, p2)), 0.0, w)
    d2, s, w = closest_segment_triangle(a, b, p0, p1, p2)
    return (triangle, d2, s, w)


@kernel
def offset(body: Body, patch: Patch, touch: Touch, a: Vector, b: Vector) -> Vector:
    """Return the vector from the surface to the probe at a touch."""
    p0, p1, p2 = corner_positions(body, patch, touch[0])
    return subtract(along(a, subtract(b, a), touch[2]), combine(touch[3], p0, p1, p2))


@kernel
def better_neighbour(body: Body, patch: Patch, touch: Touch, a: Vector, b: Vector) -> Touch:
    """Return the closest touch on the triangles that share the feature touched, or ``touch`` itself."""
    best, w = touch, touch[3]
    for corner in range(3):
        if w[corner] == 1.0:
            return _best_round(body, patch, patch.triangles[touch[0], corner], best, a, b)
    for edge in range(3):
        other = patch.neighbour[touch[0], edge]
        if w[(edge + 2) % 3] == 0.0 and other != NO_NEIGHBOUR:
            best = _closer(best, touch_triangle(body, patch, other, a, b))
    return best


@kernel
def _best_round(body: Body, patch: Patch, vertex: int, best: Touch, a: Vector, b: Vector) -> Touch:
    """Return the closest touch on the triangles round a vertex, ``best`` if none is closer."""
    start, ring = patch.ring_start, patch.ring
    for k in range(start[vertex], start[vertex + 1]):
        best = _closer(best, touch_triangle(body, patch, ring[k], a, b))
    return best


@inlined_kernel
def _best_touching(body: Body, patch: Patch, touch: Touch, a: Vector, b: Vector) -> Touch:
    """Return the closest touch on the triangles that share a corner with the touched one; none is looked at twice."""
    best, corner, start, ring = touch, patch.triangles, patch.ring_start, patch.ring
    neighbour = patch.neighbour
    first, second, third = neighbour[touch[0], 0], neighbour[touch[0], 1], neighbour[touch[0], 2]
    for other in (first, second, third):
        if other != NO_NEIGHBOUR:
            best = _closer(best, touch_triangle(body, patch, other, a, b))
    for k in range(3):
        vertex = corner[touch[0], k]
        for place in range(start[vertex], start[vertex + 1]):
            other = ring[place]
            if other != touch[0] and other not in (first, second, third):
                best = _closer(best, touch_triangle(body, patch, other, a, b))
    return best


@kernel
def _closer(best: Touch, other: Touch) -> Touch:
    return other if other[1] < best[1] else best


@kernel
def walk(body: Body, patch: Patch, triangle: int, a: Vector, b: Vector, near_m: float) -> Touch:
    """Descend over neighbouring triangles to a local minimum of the distance.

    Seen from within a bend every facet can be a local minimum of its own. Closer than ``near_m`` the minimum
    is therefore one over all triangles that share a corner with it. The distance falls strictly, so the walk
    ends; past `WALK_LIMIT` steps it gives up with triangle `NOT_FOUND`.
    """
    touch = touch_triangle(body, patch, triangle, a, b)
    for _ in range(WALK_LIMIT):
        following = better_neighbour(body, patch, touch, a, b)
        if following[0] == touch[0] and touch[1] < near_m * near_m:
            following = _best_touching(body, patch, touch, a, b)
        if following[0] == touch[0]:
            return touch
        touch = following
    return (NOT_FOUND, touch[1], touch[2], touch[3])


@kernel
def closest(body: Body, patch: Patch, a: Vector, b: Vector, radius: float, guess: int) -> Touch:
    """Return the closest touch within ``radius``, triangle `NOT_FOUND` if there is none.

    Exact: the tree is only left where its bounds forbid anything closer. ``guess`` is a triangle to start
    from, or `NOT_FOUND`; a good one saves most of the search.
    """
    best: Touch = (NOT_FOUND, radius * radius, 0.0, (1.0, 0.0, 0.0))
    if guess != NOT_FOUND:
        start = walk(body, patch, guess, a, b, 0.0)
        if start[0] != NOT_FOUND and start[1] < best[1]:
            best = start
    return _descend(body, patch, a, b, best, (0.0, 0.0, 0.0))


@inlined_kernel
def closest_opposite(body: Body, patch: Patch, a: Vector, b: Vector, radius: float, direction: Vector) -> Touch:
    """Return the closest local minimum within ``radius`` that lies opposite to ``direction``.

    ``direction`` is the unit vector from the probe to the closest touch. In a collapsed lumen this is the
    other wall.
    """
    return _descend(body, patch, a, b, (index(NOT_FOUND), radius * radius, 0.0, (1.0, 0.0, 0.0)), direction)


@kernel
def _descend(body: Body, patch: Patch, a: Vector, b: Vector, best: Touch, direction: Vector) -> Touch:
    """Depth-first search, nearer child first; a zero ``direction`` asks for the closest touch of all."""
    boxes, stack, bound = patch.boxes, patch.stack, patch.bound
    stack[0] = 0
    bound[0] = distance2_below(body, patch, index(0), a, b, best[1], direction)
    top = 1
    while top > 0:
        top -= 1
        node = index(stack[top])
        if bound[top] >= best[1]:
            continue
        if is_leaf(boxes, node):
            best = _search_leaf(body, patch, node, a, b, best, direction)
            continue
        left, right = index(boxes[node, CHILD]), index(boxes[node, CHILD_RIGHT])
        near = distance2_below(body, patch, left, a, b, best[1], direction)
        far = distance2_below(body, patch, right, a, b, best[1], direction)
        join_children(body, patch, node, best[1])
        if near > far:
            near, far, left, right = far, near, right, left
        if far < best[1]:
            stack[top], bound[top] = right, far
            top += 1
        if near < best[1]:
            stack[top], bound[top] = left, near
            top += 1
    return best


@kernel
def distance_to_all(body: Body, patch: Patch, a: Vector, b: Vector) -> float:
    """Return a cheap lower bound of the distance from the probe to the whole patch."""
    return math.sqrt(distance2_below(body, patch, index(0), a, b, math.inf, (0.0, 0.0, 0.0)))


@inlined_kernel
def _search_leaf(body: Body, patch: Patch, node: int, a: Vector, b: Vector, best: Touch, direction: Vector) -> Touch:
    wants_opposite = dot(direction, direction) > 0.0
    span, order = patch.span, patch.order
    for k in range(span[node, 0], span[node, 1]):
        touch = touch_triangle(body, patch, order[k], a, b)
        if touch[1] >= best[1]:
            continue
        if wants_opposite:
            towards = scaled(offset(body, patch, touch, a, b), -1.0)
            if dot(towards, direction) > OPPOSITE * math.sqrt(touch[1]):
                continue
            if better_neighbour(body, patch, touch, a, b)[0] != touch[0]:
                continue
        best = touch
    return best
