"""A tree of axis-aligned bounding boxes (AABB) over the rest shape that stays valid while the duct deforms.

Nothing in it is refitted. Two numbers a tree node are enough (see `motion_bounds`): how far its vertices can move
(``reach``), and how far they can move against one representative vertex (``spread``), in m per sqrt(J) of the
wall's |omega q|. A rest box moved by the representative's displacement and inflated by ``spread`` |omega q|
contains the deformed triangles, always; deep in the tree it is tight.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from services.mechanics.arrays import FloatArray, IntArray
from services.mechanics.collision.motion_bounds import MotionBounds

LEAF_TRIANGLES = 4
LEAF = -1
_CHUNK = 4096


class AabbTree(NamedTuple):
    """Tree of axis-aligned bounding boxes as arrays, one row a node, the root first."""

    box: FloatArray
    """(k, 2, 3) rest bounds: lowest and highest corner."""
    child: IntArray
    """(k, 2) children, or (`LEAF`, `LEAF`)."""
    span: IntArray
    """(k, 2) first and one past last entry of ``order`` below the node."""
    order: IntArray
    """(m,) triangles, those of one node side by side."""
    representative: IntArray
    """(k,) vertex whose displacement moves the box."""
    reach: FloatArray
    """(k,) bound of |u_i| / |omega q|."""
    spread: FloatArray
    """(k,) bound of |u_i - u_representative| / |omega q|."""


def build_tree(vertices_m: FloatArray, triangles: IntArray, bounds: MotionBounds) -> AabbTree:
    """Build the tree over triangles (m, 3)."""
    order, span, child = _split(vertices_m[triangles].mean(axis=1))
    k = len(span)
    box = np.empty((k, 2, 3))
    representative = np.empty(k, np.int32)
    members: list[IntArray] = []
    for node, (first, last) in enumerate(span):
        corners = np.unique(triangles[order[first:last]])
        if not len(corners):
            # A patch without triangles: a box that nothing is near.
            box[node, 0], box[node, 1] = np.inf, -np.inf
            representative[node] = 0
            members.append(corners)
            continue
        points = vertices_m[corners]
        box[node] = points.min(axis=0), points.max(axis=0)
        middle = 0.5 * (box[node, 0] + box[node, 1])
        representative[node] = corners[np.argmin(((points - middle) ** 2).sum(axis=1))]
        members.append(corners)
    owner = np.repeat(np.arange(k, dtype=np.int32), [len(corners) for corners in members])
    vertex = np.concatenate(members)
    reach, spread = _displacement_bounds(bounds, vertex, owner, representative)
    return AabbTree(box, child, span, order, representative, reach, spread)


def _split(centroids: FloatArray) -> tuple[IntArray, IntArray, IntArray]:
    """Median splits along the longest side: (order, span, child)."""
    order = np.arange(len(centroids), dtype=np.int32)
    spans, children = [(0, len(order))], [[LEAF, LEAF]]
    pending = [0]
    while pending:
        node = pending.pop()
        first, last = spans[node]
        if last - first <= LEAF_TRIANGLES:
            continue
        points = centroids[order[first:last]]
        axis = int(np.argmax(np.ptp(points, axis=0)))
        middle = (last - first) // 2
        order[first:last] = order[first:last][np.argpartition(points[:, axis], middle)]
        children[node] = [len(spans), len(spans) + 1]
        pending += children[node]
        spans += [(first, first + middle), (first + middle, last)]
        children += [[LEAF, LEAF], [LEAF, LEAF]]
    return order, np.array(spans, np.int32), np.array(children, np.int32)


def _displacement_bounds(
    bounds: MotionBounds, vertex: IntArray, owner: IntArray, representative: IntArray
) -> tuple[FloatArray, FloatArray]:
    reach, spread = np.zeros(len(representative)), np.zeros(len(representative))
    for first in range(0, len(vertex), _CHUNK):
        rows = slice(first, first + _CHUNK)
        np.maximum.at(reach, owner[rows], bounds.reach(vertex[rows]))
        np.maximum.at(spread, owner[rows], bounds.spread(vertex[rows], representative[owner[rows]]))
    return reach, spread
