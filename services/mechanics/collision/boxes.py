"""Distances to the boxes of the tree, as tight as what is known of the deformed triangles allows.

Three bounds hold at any time: the rest box inflated by how far its vertices can move; the rest box moved with its
representative vertex and inflated by how far the others can move against that one (see `tree`); and the bounds
as they were last looked at, inflated by how far any node can have travelled since. Leaves are looked at when a
search comes close, their parents are joined from them: the parts of the wall that are being touched soon have
tight boxes, and no part that is not touched costs anything.
"""

from __future__ import annotations

import math

from services.mechanics.collision.kernel import floats, ints, kernel
from services.mechanics.collision.primitives import Vector, dot, put, subtract, vector
from services.mechanics.collision.surface import Body, Patch, node_position
from services.mechanics.collision.tree import LEAF

Box = tuple[Vector, Vector]
# Two contacts of one probe look more than 60 degrees apart.
APART = 0.5
# A looser box than this part of the distance in question is worth tightening.
_LOOSE = 0.1
_STILL = (0.0, 0.0, 0.0)


@kernel
def distance2_below(
    body: Body, patch: Patch, node: int, a: Vector, b: Vector, limit2: float, direction: Vector
) -> float:
    """Return a lower bound of the squared distance from segment ab to every deformed triangle below a node.

    Infinite where all of them lie so far along ``direction`` that none within the limit is `APART` from it.
    """
    body.tree_visits += 1
    loose = _LOOSE * math.sqrt(limit2)
    drift = _drift(body, patch, node)
    if drift < loose:
        return _bound2(_box(patch.seen_box, node, _STILL, drift), a, b, limit2, direction)
    slack = floats(patch.reach)[node] * body.energy_norm + body.largest_residual
    d2 = _bound2(_box(patch.box, node, _STILL, slack), a, b, limit2, direction)
    if d2 >= limit2:
        return d2
    if ints(patch.child)[2 * node] == LEAF:
        _look_at_leaf(body, patch, node)
        return _bound2(_box(patch.seen_box, node, _STILL, 0.0), a, b, limit2, direction)
    tight = floats(patch.spread)[node] * body.energy_norm + 2.0 * body.largest_residual
    if slack - tight > loose:
        vertex = ints(patch.representative)[node]
        shift = subtract(node_position(body, vertex), vector(floats(body.rest), vertex))
        d2 = max(d2, _bound2(_box(patch.box, node, shift, tight), a, b, limit2, direction))
    if drift < math.inf:
        d2 = max(d2, _bound2(_box(patch.seen_box, node, _STILL, drift), a, b, limit2, direction))
    return d2


@kernel
def join_children(body: Body, patch: Patch, node: int) -> None:
    """Replace what was last seen of a node by what was since seen of its children."""
    left, right = ints(patch.child)[2 * node], ints(patch.child)[2 * node + 1]
    drift_left, drift_right = _drift(body, patch, left), _drift(body, patch, right)
    if not max(drift_left, drift_right) < _drift(body, patch, node):
        return
    low, high = _box(patch.seen_box, left, _STILL, drift_left)
    other_low, other_high = _box(patch.seen_box, right, _STILL, drift_right)
    _note(body, patch, node, _lower(low, other_low), _upper(high, other_high))


@kernel
def _look_at_leaf(body: Body, patch: Patch, node: int) -> None:
    low, high = (math.inf, math.inf, math.inf), (-math.inf, -math.inf, -math.inf)
    span, order, corner = ints(patch.span), ints(patch.order), ints(patch.triangles)
    for k in range(span[2 * node], span[2 * node + 1]):
        for c in range(3):
            p = node_position(body, corner[3 * order[k] + c])
            low, high = _lower(low, p), _upper(high, p)
    _note(body, patch, node, low, high)


@kernel
def _note(body: Body, patch: Patch, node: int, low: Vector, high: Vector) -> None:
    put(floats(patch.seen_box), 2 * node, low)
    put(floats(patch.seen_box), 2 * node + 1, high)
    floats(patch.seen_travel)[node] = body.travel


@kernel
def _drift(body: Body, patch: Patch, node: int) -> float:
    """Return how far any vertex can have moved since the node was looked at, infinite if it never was."""
    seen = floats(patch.seen_travel)[node]
    return body.travel - seen if seen >= 0.0 else math.inf


@kernel
def _box(address: int, node: int, shift: Vector, slack: float) -> Box:
    low, high = vector(floats(address), 2 * node), vector(floats(address), 2 * node + 1)
    return (
        (low[0] + shift[0] - slack, low[1] + shift[1] - slack, low[2] + shift[2] - slack),
        (high[0] + shift[0] + slack, high[1] + shift[1] + slack, high[2] + shift[2] + slack),
    )


@kernel
def _bound2(box: Box, a: Vector, b: Vector, limit2: float, direction: Vector) -> float:
    """Return the squared distance between a box and the bounds of ab, infinite beyond the excluded cone."""
    low, high = box
    total, nearest = 0.0, -max(dot(a, direction), dot(b, direction))
    for axis in range(3):
        gap = max(low[axis] - max(a[axis], b[axis]), min(a[axis], b[axis]) - high[axis])
        if gap > 0.0:
            total += gap * gap
        nearest += direction[axis] * (low[axis] if direction[axis] > 0.0 else high[axis])
    return math.inf if nearest > APART * math.sqrt(limit2) else total


@kernel
def _lower(u: Vector, v: Vector) -> Vector:
    return (min(u[0], v[0]), min(u[1], v[1]), min(u[2], v[2]))


@kernel
def _upper(u: Vector, v: Vector) -> Vector:
    return (max(u[0], v[0]), max(u[1], v[1]), max(u[2], v[2]))
