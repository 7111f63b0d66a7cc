"""Broad phase: distances to the boxes of the AABB tree, as tight as what is known of the deformed triangles allows.

Three bounds hold at any time: the rest box inflated by how far its vertices can move; the rest box moved with its
representative vertex and inflated by how far the others can move against that one (see `aabb_tree`); and the bounds
as they were last looked at, moved and inflated in the same way by what has happened since. Leaves are looked at
when a search comes close, their parents are joined from them: the parts of the wall that are being touched soon
have tight boxes, and no part that is not touched costs anything.
"""

from __future__ import annotations

import math

from services.mechanics.arrays import FloatArray
from services.mechanics.collision.boxes import (
    CHILD,
    CHILD_RIGHT,
    REACH,
    REPRESENTATIVE,
    REST_LOW,
    SEEN_AT,
    SEEN_BOTTOM,
    SEEN_ENERGY,
    SEEN_HIGH,
    SEEN_LOW,
    SEEN_NORMAL,
    SEEN_RESIDUAL,
    SEEN_TOP,
    SEEN_TURNED,
    SPREAD,
    is_leaf,
    put_vector,
    vector_at,
)
from services.mechanics.collision.nodes import corner_positions, node_position
from services.mechanics.collision.primitives import index
from services.mechanics.collision.shell import Body, Patch
from services.mechanics.compiled import inlined_kernel, kernel
from services.mechanics.compiled.vectors import (
    Vector,
    along,
    cross,
    dot,
    row,
    subtract,
    unit,
)

Box = tuple[Vector, Vector]
# Cosine between the directions of the two contacts of one probe at which they count as opposite walls.
OPPOSITE = -0.25
# A looser box than this part of the distance in question is worth tightening.
_LOOSE = 0.1
_STILL = (0.0, 0.0, 0.0)


@kernel
def distance2_below(
    body: Body, patch: Patch, node: int, a: Vector, b: Vector, limit2: float, direction: Vector
) -> float:
    """Return a lower bound of the squared distance from segment ab to every deformed triangle below a node.

    Infinite where none of them lies `OPPOSITE` to ``direction``, unless that is zero.
    """
    boxes = patch.boxes
    body.tree_visits += 1
    loose = _LOOSE * math.sqrt(limit2)
    drift = _drift(body, patch, node)
    if drift < loose:
        return _seen_bound2(patch, node, _STILL, drift, (a, b), direction)
    slack = boxes[node, REACH] * body.energy_norm + body.largest_residual + body.turned_shift
    d2 = _bound2(_box(boxes, REST_LOW, node, _STILL, slack), a, b, direction)
    if d2 >= limit2:
        return d2
    if drift < math.inf:
        shift, tight = _motion_since(body, patch, node)
        d2 = max(d2, _seen_bound2(patch, node, shift, tight, (a, b), direction))
    else:
        vertex = index(boxes[node, REPRESENTATIVE])
        tight = boxes[node, SPREAD] * body.energy_norm + 2.0 * body.largest_residual
        if slack - tight > loose:
            shift = subtract(node_position(body, vertex), row(body.rest, vertex))
            d2 = max(d2, _bound2(_box(boxes, REST_LOW, node, shift, tight), a, b, direction))
    if d2 < limit2 and tight > loose and is_leaf(boxes, node):
        _look_at_leaf(body, patch, node)
        return _seen_bound2(patch, node, _STILL, 0.0, (a, b), direction)
    return d2


@kernel
def join_children(body: Body, patch: Patch, node: int, limit2: float) -> None:
    """Replace what was last seen of a node by what was since seen of its children.

    Not where it is tight enough as it is for a search of this squared distance: a node of the wall that nobody else
    needs would have to be placed.
    """
    boxes = patch.boxes
    left, right = index(boxes[node, CHILD]), index(boxes[node, CHILD_RIGHT])
    stale = 0.5 * _drift(body, patch, node)
    if stale < 0.5 * _LOOSE * math.sqrt(limit2):
        return
    if not (_drift(body, patch, left) < math.inf and _drift(body, patch, right) < math.inf):
        return
    shift_left, tight_left = _motion_since(body, patch, left)
    shift_right, tight_right = _motion_since(body, patch, right)
    if not max(tight_left, tight_right) < stale:
        return
    low, high = _box(boxes, SEEN_LOW, left, shift_left, tight_left)
    other_low, other_high = _box(boxes, SEEN_LOW, right, shift_right, tight_right)
    _note(body, patch, node, _lower(low, other_low), _upper(high, other_high))


@kernel
def _motion_since(body: Body, patch: Patch, node: int) -> tuple[Vector, float]:
    """Return how a node's triangles have moved since it was looked at: a shift, and how far any can be off it."""
    boxes = patch.boxes
    drift = _drift(body, patch, node)
    energy = body.energy_travel - boxes[node, SEEN_ENERGY]
    tight = boxes[node, SPREAD] * energy + 2.0 * (body.residual_travel - boxes[node, SEEN_RESIDUAL])
    if drift <= 1.5 * tight:
        return _STILL, drift
    now = node_position(body, index(boxes[node, REPRESENTATIVE]))
    return subtract(now, vector_at(boxes, node, SEEN_AT)), tight


@inlined_kernel
def _look_at_leaf(body: Body, patch: Patch, node: int) -> None:
    """Note the box of a leaf and the slab about its mean normal, which is thin where the wall is tilted."""
    low, high, normal = (math.inf, math.inf, math.inf), (-math.inf, -math.inf, -math.inf), _STILL
    span, order = patch.span, patch.order
    for k in range(span[node, 0], span[node, 1]):
        p0, p1, p2 = corner_positions(body, patch, order[k])
        normal = along(normal, cross(subtract(p1, p0), subtract(p2, p0)), 1.0)
        low, high = _lower(_lower(low, p0), _lower(p1, p2)), _upper(_upper(high, p0), _upper(p1, p2))
    normal = unit(normal)
    bottom, top = math.inf, -math.inf
    for k in range(span[node, 0], span[node, 1]):
        for p in corner_positions(body, patch, order[k]):
            bottom, top = min(bottom, dot(p, normal)), max(top, dot(p, normal))
    _note(body, patch, node, low, high)
    _note_slab(patch, node, normal, bottom, top)


@kernel
def _note(body: Body, patch: Patch, node: int, low: Vector, high: Vector) -> None:
    boxes = patch.boxes
    put_vector(boxes, node, SEEN_LOW, low)
    put_vector(boxes, node, SEEN_HIGH, high)
    put_vector(boxes, node, SEEN_AT, node_position(body, index(boxes[node, REPRESENTATIVE])))
    boxes[node, SEEN_ENERGY] = body.energy_noted
    boxes[node, SEEN_RESIDUAL] = body.residual_travel
    boxes[node, SEEN_TURNED] = body.turned_travel


@kernel
def _note_slab(patch: Patch, node: int, normal: Vector, bottom: float, top: float) -> None:
    boxes = patch.boxes
    put_vector(boxes, node, SEEN_NORMAL, normal)
    boxes[node, SEEN_BOTTOM], boxes[node, SEEN_TOP] = bottom, top


@kernel
def _seen_bound2(
    patch: Patch, node: int, shift: Vector, slack: float, ends: tuple[Vector, Vector], direction: Vector
) -> float:
    """Return the bound from what was last seen of a node: its box, and a leaf's slab, moved and inflated."""
    boxes = patch.boxes
    d2 = _bound2(_box(boxes, SEEN_LOW, node, shift, slack), ends[0], ends[1], direction)
    if not is_leaf(boxes, node):
        return d2
    normal = vector_at(boxes, node, SEEN_NORMAL)
    from_a, from_b, moved = dot(ends[0], normal), dot(ends[1], normal), dot(shift, normal)
    bottom, top = boxes[node, SEEN_BOTTOM] + moved, boxes[node, SEEN_TOP]
    gap = max(bottom - max(from_a, from_b), min(from_a, from_b) - top - moved) - slack
    return max(d2, gap * gap) if gap > 0.0 else d2


@kernel
def _drift(body: Body, patch: Patch, node: int) -> float:
    """Return how far any vertex can have moved since the node was looked at, infinite if it never was."""
    boxes = patch.boxes
    seen = boxes[node, SEEN_ENERGY]
    if seen == -math.inf:
        return math.inf
    energy = boxes[node, REACH] * (body.energy_travel - seen)
    residual = body.residual_travel - boxes[node, SEEN_RESIDUAL]
    drift: float = energy + residual + body.turned_travel - boxes[node, SEEN_TURNED]
    return drift


@kernel
def _box(boxes: FloatArray, column: int, node: int, shift: Vector, slack: float) -> Box:
    low, high = vector_at(boxes, node, column), vector_at(boxes, node, column + 3)
    return (
        (low[0] + shift[0] - slack, low[1] + shift[1] - slack, low[2] + shift[2] - slack),
        (high[0] + shift[0] + slack, high[1] + shift[1] + slack, high[2] + shift[2] + slack),
    )


@kernel
def _bound2(box: Box, a: Vector, b: Vector, direction: Vector) -> float:
    """Return the squared distance between a box and the bounds of ab, infinite if nothing in it is opposite."""
    low, high = box
    total, nearest = 0.0, -max(dot(a, direction), dot(b, direction))
    for axis in range(3):
        gap = max(low[axis] - max(a[axis], b[axis]), min(a[axis], b[axis]) - high[axis])
        if gap > 0.0:
            total += gap * gap
        nearest += direction[axis] * (low[axis] if direction[axis] > 0.0 else high[axis])
    if nearest > OPPOSITE * math.sqrt(total) and dot(direction, direction) > 0.0:
        return math.inf
    return total


@kernel
def _lower(u: Vector, v: Vector) -> Vector:
    return (min(u[0], v[0]), min(u[1], v[1]), min(u[2], v[2]))


@kernel
def _upper(u: Vector, v: Vector) -> Vector:
    return (max(u[0], v[0]), max(u[1], v[1]), max(u[2], v[2]))
