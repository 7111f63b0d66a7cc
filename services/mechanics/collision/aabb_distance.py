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
from services.mechanics.collision.aabb_tree import LEAF
from services.mechanics.collision.nodes import corner_positions, node_position
from services.mechanics.collision.shell import Body, Patch
from services.mechanics.compiled import kernel
from services.mechanics.compiled.vectors import (
    Vector,
    along,
    cross,
    dot,
    put_row,
    put_row_of,
    row,
    row_of,
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
    body.tree_visits += 1
    loose = _LOOSE * math.sqrt(limit2)
    drift = _drift(body, patch, node)
    if drift < loose:
        return _seen_bound2(patch, node, _STILL, drift, (a, b), direction)
    slack = patch.reach[node] * body.energy_norm + body.largest_residual + body.turned_shift
    d2 = _bound2(_box(patch.box, node, _STILL, slack), a, b, direction)
    if d2 >= limit2:
        return d2
    if drift < math.inf:
        shift, tight = _motion_since(body, patch, node)
        d2 = max(d2, _seen_bound2(patch, node, shift, tight, (a, b), direction))
    else:
        vertex = patch.representative[node]
        tight = patch.spread[node] * body.energy_norm + 2.0 * body.largest_residual
        if slack - tight > loose:
            shift = subtract(node_position(body, vertex), row(body.rest, vertex))
            d2 = max(d2, _bound2(_box(patch.box, node, shift, tight), a, b, direction))
    if d2 < limit2 and tight > loose and patch.child[node, 0] == LEAF:
        _look_at_leaf(body, patch, node)
        return _seen_bound2(patch, node, _STILL, 0.0, (a, b), direction)
    return d2


@kernel
def join_children(body: Body, patch: Patch, node: int, limit2: float) -> None:
    """Replace what was last seen of a node by what was since seen of its children.

    Not where it is tight enough as it is for a search of this squared distance: a node of the wall that nobody else
    needs would have to be placed.
    """
    left, right = patch.child[node, 0], patch.child[node, 1]
    stale = 0.5 * _drift(body, patch, node)
    if stale < 0.5 * _LOOSE * math.sqrt(limit2):
        return
    if not (_drift(body, patch, left) < math.inf and _drift(body, patch, right) < math.inf):
        return
    shift_left, tight_left = _motion_since(body, patch, left)
    shift_right, tight_right = _motion_since(body, patch, right)
    if not max(tight_left, tight_right) < stale:
        return
    low, high = _box(patch.seen_box, left, shift_left, tight_left)
    other_low, other_high = _box(patch.seen_box, right, shift_right, tight_right)
    _note(body, patch, node, _lower(low, other_low), _upper(high, other_high))


@kernel
def _motion_since(body: Body, patch: Patch, node: int) -> tuple[Vector, float]:
    """Return how a node's triangles have moved since it was looked at: a shift, and how far any can be off it."""
    drift = _drift(body, patch, node)
    energy = body.energy_travel - patch.seen_energy[node]
    tight = patch.spread[node] * energy + 2.0 * (body.residual_travel - patch.seen_residual[node])
    if drift <= 1.5 * tight:
        return _STILL, drift
    now = node_position(body, patch.representative[node])
    return subtract(now, row(patch.seen_at, node)), tight


@kernel
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
    put_row_of(patch.seen_box, node, 0, low)
    put_row_of(patch.seen_box, node, 1, high)
    put_row(patch.seen_at, node, node_position(body, patch.representative[node]))
    patch.seen_energy[node] = body.energy_noted
    patch.seen_residual[node] = body.residual_travel
    patch.seen_turned[node] = body.turned_travel


@kernel
def _note_slab(patch: Patch, node: int, normal: Vector, bottom: float, top: float) -> None:
    put_row(patch.seen_normal, node, normal)
    patch.seen_slab[node, 0], patch.seen_slab[node, 1] = bottom, top


@kernel
def _seen_bound2(
    patch: Patch, node: int, shift: Vector, slack: float, ends: tuple[Vector, Vector], direction: Vector
) -> float:
    """Return the bound from what was last seen of a node: its box, and a leaf's slab, moved and inflated."""
    d2 = _bound2(_box(patch.seen_box, node, shift, slack), ends[0], ends[1], direction)
    if patch.child[node, 0] != LEAF:
        return d2
    normal, slab = row(patch.seen_normal, node), patch.seen_slab
    from_a, from_b, moved = dot(ends[0], normal), dot(ends[1], normal), dot(shift, normal)
    gap = max(slab[node, 0] + moved - max(from_a, from_b), min(from_a, from_b) - slab[node, 1] - moved) - slack
    return max(d2, gap * gap) if gap > 0.0 else d2


@kernel
def _drift(body: Body, patch: Patch, node: int) -> float:
    """Return how far any vertex can have moved since the node was looked at, infinite if it never was."""
    seen = patch.seen_energy[node]
    if seen == -math.inf:
        return math.inf
    energy = patch.reach[node] * (body.energy_travel - seen)
    residual = body.residual_travel - patch.seen_residual[node]
    drift: float = energy + residual + body.turned_travel - patch.seen_turned[node]
    return drift


@kernel
def _box(boxes: FloatArray, node: int, shift: Vector, slack: float) -> Box:
    low, high = row_of(boxes, node, 0), row_of(boxes, node, 1)
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
