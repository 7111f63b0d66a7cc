"""The boxes of an `AabbTree` as a search reads them: all of a box in one row, what every visit needs in front.

A search goes past some 200 boxes, most of which no cache holds by then: where the numbers of one lay in eleven arrays,
235 boxes took 13 us with warm caches and 97 with cold ones.
"""

from __future__ import annotations

import numpy as np

from services.mechanics.arrays import FloatArray
from services.mechanics.collision.aabb_tree import LEAF, AabbTree
from services.mechanics.compiled import kernel
from services.mechanics.compiled.vectors import Vector

WIDTH = 32
#: The surface's energy travel when the triangles below were last looked at, -inf if never; its residual travel then,
#: and that of its sections.
SEEN_ENERGY, SEEN_RESIDUAL, SEEN_TURNED = 0, 1, 2
REACH, CHILD, CHILD_RIGHT = 3, 4, 5
#: Bounds of the deformed triangles when they were last looked at.
SEEN_LOW, SEEN_HIGH = 6, 9
#: A leaf's mean normal at the same moment, and lowest and highest offset of its triangles along that.
SEEN_NORMAL, SEEN_BOTTOM, SEEN_TOP = 12, 15, 16
#: The representative vertex then.
SEEN_AT = 17
SPREAD, REPRESENTATIVE = 20, 21
REST_LOW = 22  # and 25: bounds of the undeformed triangles
#: The region that the box is the root of, see `regions`, or `NO_REGION`.
REGION, NO_REGION = 28, -1
_LINE = 64


def box_rows(tree: AabbTree) -> FloatArray:
    """Return (k, `WIDTH`) rows that begin with a line of the cache, nothing looked at yet."""
    k = len(tree.box)
    raw = np.zeros(k * WIDTH + _LINE // 8)
    first = -raw.ctypes.data % _LINE // 8
    rows = raw[first : first + k * WIDTH].reshape(k, WIDTH)
    rows[:, SEEN_ENERGY] = -np.inf
    rows[:, REACH], rows[:, SPREAD] = tree.reach, tree.spread
    rows[:, CHILD : CHILD + 2] = tree.child
    rows[:, REPRESENTATIVE] = tree.representative
    rows[:, REGION] = NO_REGION
    rows[:, REST_LOW : REST_LOW + 6] = rows[:, SEEN_LOW : SEEN_LOW + 6] = tree.box.reshape(k, 6)
    return rows


@kernel
def is_leaf(boxes: FloatArray, node: int) -> bool:
    """Return whether a box has no others in it."""
    return bool(boxes[node, CHILD] == LEAF)


@kernel
def vector_at(boxes: FloatArray, node: int, column: int) -> Vector:
    """Return three numbers of a row."""
    return (boxes[node, column], boxes[node, column + 1], boxes[node, column + 2])


@kernel
def put_vector(boxes: FloatArray, node: int, column: int, v: Vector) -> None:
    """Set three numbers of a row."""
    boxes[node, column], boxes[node, column + 1], boxes[node, column + 2] = v[0], v[1], v[2]
