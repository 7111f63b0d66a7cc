"""Closest triangle of a deforming patch to a short segment: by tree from nothing, by walking from a guess.

A *probe* is a segment a -> b; a particle is a probe with a == b. A *touch* is where probe and surface come
closest: (triangle, squared distance, s on the probe, barycentric weights).
"""

from __future__ import annotations

import math

from services.mechanics.collision.kernel import inlined, kernel
from services.mechanics.collision.primitives import (
    Vector,
    along,
    closest_on_triangle,
    closest_segment_triangle,
    combine,
    dot,
    scaled,
    squared_distance,
    subtract,
)
from services.mechanics.collision.surface import (
    ENERGY_NORM,
    LARGEST_RESIDUAL,
    TREE_VISITS,
    TRIANGLE_TESTS,
    Body,
    Patch,
    corner_positions,
    node_position,
)
from services.mechanics.collision.topology import NO_NEIGHBOUR
from services.mechanics.collision.tree import LEAF

Touch = tuple[int, float, float, Vector]
NOTHING = -1
WALK_LIMIT = 256
# Two contacts of one probe look more than 60 degrees apart.
APART = 0.5


@kernel
def touch_triangle(body: Body, patch: Patch, triangle: int, a: Vector, b: Vector) -> Touch:
    """Return the touch of probe ab on one triangle."""
    body.count[TRIANGLE_TESTS] += 1
    p0, p1, p2 = corner_positions(body, patch.triangles, triangle)
    if a == b:
        w = closest_on_triangle(a, p0, p1, p2)
        return (triangle, squared_distance(a, combine(w, p0, p1, p2)), 0.0, w)
    d2, s, w = closest_segment_triangle(a, b, p0, p1, p2)
    return (triangle, d2, s, w)


@inlined
def offset(body: Body, patch: Patch, touch: Touch, a: Vector, b: Vector) -> Vector:
    """Return the vector from the surface to the probe at a touch."""
    p0, p1, p2 = corner_positions(body, patch.triangles, touch[0])
    return subtract(along(a, subtract(b, a), touch[2]), combine(touch[3], p0, p1, p2))


@kernel
def better_neighbour(body: Body, patch: Patch, touch: Touch, a: Vector, b: Vector) -> Touch:
    """Return the closest touch on the triangles that share the feature touched, or ``touch`` itself."""
    best = touch
    w = touch[3]
    for corner in range(3):
        if w[corner] == 1.0:
            vertex = patch.triangles[touch[0], corner]
            for k in range(patch.ring_start[vertex], patch.ring_start[vertex + 1]):
                other = touch_triangle(body, patch, patch.ring[k], a, b)
                if other[1] < best[1]:
                    best = other
            return best
    for edge in range(3):
        if w[(edge + 2) % 3] == 0.0 and patch.neighbour[touch[0], edge] != NO_NEIGHBOUR:
            other = touch_triangle(body, patch, patch.neighbour[touch[0], edge], a, b)
            if other[1] < best[1]:
                best = other
    return best


@kernel
def walk(body: Body, patch: Patch, triangle: int, a: Vector, b: Vector) -> Touch:
    """Descend over neighbouring triangles to a local minimum of the distance.

    The distance falls strictly, so the walk ends; past `WALK_LIMIT` steps it gives up with triangle `NOTHING`.
    """
    touch = touch_triangle(body, patch, triangle, a, b)
    for _ in range(WALK_LIMIT):
        following = better_neighbour(body, patch, touch, a, b)
        if following[0] == touch[0]:
            return touch
        touch = following
    return (NOTHING, touch[1], touch[2], touch[3])


@kernel
def closest(body: Body, patch: Patch, a: Vector, b: Vector, radius: float, guess: int) -> Touch:
    """Return the closest touch within ``radius``, triangle `NOTHING` if there is none.

    Exact: the tree is only left where its bounds forbid anything closer. ``guess`` is a triangle to start
    from, or `NOTHING`; a good one saves most of the search.
    """
    best: Touch = (NOTHING, radius * radius, 0.0, (1.0, 0.0, 0.0))
    if guess != NOTHING:
        start = walk(body, patch, guess, a, b)
        if start[0] != NOTHING and start[1] < best[1]:
            best = start
    return _descend(body, patch, a, b, best, (0.0, 0.0, 0.0))


@kernel
def closest_apart(body: Body, patch: Patch, a: Vector, b: Vector, radius: float, direction: Vector) -> Touch:
    """Return the closest local minimum within ``radius`` that lies more than 60 degrees off ``direction``.

    ``direction`` is the unit vector from the probe to the closest touch. In a collapsed lumen or a crease
    this is the other wall.
    """
    return _descend(body, patch, a, b, (NOTHING, radius * radius, 0.0, (1.0, 0.0, 0.0)), direction)


@kernel
def _descend(body: Body, patch: Patch, a: Vector, b: Vector, best: Touch, direction: Vector) -> Touch:
    """Depth-first search, nearer child first; a zero ``direction`` asks for the closest touch of all."""
    tree, stack, bound = patch.tree, patch.stack, patch.bound
    stack[0], bound[0] = 0, _distance2_below(body, patch, 0, a, b, best[1], direction)
    top = 1
    while top > 0:
        top -= 1
        node = stack[top]
        if bound[top] >= best[1]:
            continue
        left, right = tree.child[node, 0], tree.child[node, 1]
        if left == LEAF:
            best = _search_leaf(body, patch, node, a, b, best, direction)
            continue
        near = _distance2_below(body, patch, left, a, b, best[1], direction)
        far = _distance2_below(body, patch, right, a, b, best[1], direction)
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
    return math.sqrt(_distance2_below(body, patch, 0, a, b, math.inf, (0.0, 0.0, 0.0)))


@inlined
def _search_leaf(
    body: Body, patch: Patch, node: int, a: Vector, b: Vector, best: Touch, direction: Vector
) -> Touch:
    wants_apart = dot(direction, direction) > 0.0
    for k in range(patch.tree.span[node, 0], patch.tree.span[node, 1]):
        touch = touch_triangle(body, patch, patch.tree.order[k], a, b)
        if touch[1] >= best[1]:
            continue
        if wants_apart:
            towards = scaled(offset(body, patch, touch, a, b), -1.0)
            if dot(towards, direction) > APART * math.sqrt(touch[1]):
                continue
            if better_neighbour(body, patch, touch, a, b)[0] != touch[0]:
                continue
        best = touch
    return best


@inlined
def _distance2_below(
    body: Body, patch: Patch, node: int, a: Vector, b: Vector, limit2: float, direction: Vector
) -> float:
    """Return a lower bound of the squared distance from the probe to every deformed triangle below a node."""
    body.count[TREE_VISITS] += 1
    tree, norm, residual = patch.tree, body.measure[ENERGY_NORM], body.measure[LARGEST_RESIDUAL]
    slack = tree.reach[node] * norm + residual
    still = (0.0, 0.0, 0.0)
    d2 = _box_distance2(tree.box, node, still, slack, a, b)
    tight = tree.spread[node] * norm + 2.0 * residual
    if d2 < limit2 and slack - tight > 0.1 * math.sqrt(limit2):
        # Worth placing one vertex: the box moves with it.
        vertex = tree.representative[node]
        p = node_position(body, vertex)
        still = (p[0] - body.rest[vertex, 0], p[1] - body.rest[vertex, 1], p[2] - body.rest[vertex, 2])
        slack = tight
        d2 = max(d2, _box_distance2(tree.box, node, still, slack, a, b))
    if d2 < limit2 and _is_beyond(tree.box, node, still, slack, a, b, direction, math.sqrt(limit2)):
        return math.inf
    return d2


@inlined
def _box_distance2(box, node: int, shift: Vector, slack: float, a: Vector, b: Vector) -> float:  # type: ignore[no-untyped-def]
    """Return the squared distance between the inflated box and the bounds of the probe."""
    total = 0.0
    for axis in range(3):
        low = box[node, axis] + shift[axis] - slack
        high = box[node, axis + 3] + shift[axis] + slack
        gap = max(low - max(a[axis], b[axis]), min(a[axis], b[axis]) - high)
        if gap > 0.0:
            total += gap * gap
    return total


@inlined
def _is_beyond(box, node, shift, slack, a, b, direction, radius) -> bool:  # type: ignore[no-untyped-def]
    """Return whether the whole box lies within the excluded cone round ``direction`` up to ``radius``."""
    furthest = max(dot(a, direction), dot(b, direction))
    nearest = 0.0
    for axis in range(3):
        low = box[node, axis] + shift[axis] - slack
        high = box[node, axis + 3] + shift[axis] + slack
        nearest += direction[axis] * (low if direction[axis] > 0.0 else high)
    return nearest - furthest > APART * radius
