"""How far parts of a straight wall have moved against each other since a probe has searched: a second opinion.

What a search of `probes` has seen is good until probe and wall have moved by its slack. The sum of all motion since, of
the softest node of all, is cheap, and far too much for a hand that trembles: the wall swings to and fro with it by
tenths of a millimetre, the catheter in it as well, and hardly deforms. So before a probe searches it is asked how far
the wall near it *is* from where it was then, seen from the piece of the wall next to it.

A region is a subtree of the search tree. What moves it is the translation of a vertex in its middle, and what its
vertices do against that one: with M_i the modes of vertex i less those of the middle, over omega, V the leading right
singular vectors of all M_i below each other and S the singular values,
|M_i y| <= max_i |M_i V / S| |S V^T y| + max_i |M_i - M_i V V^T| |y|, y = omega dq: a few numbers bound all vertices.
What modes do not know of, the residuals of loaded nodes, is remembered node by node: a hand that presses and trembles
changes them by a part of what they are.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple, Self

import numpy as np

from services.mechanics.arrays import ByteArray, FloatArray, IntArray, LongArray
from services.mechanics.collision.aabb_distance import distance2_below
from services.mechanics.collision.aabb_tree import LEAF, AabbTree
from services.mechanics.collision.boxes import CHILD, CHILD_RIGHT, REGION, is_leaf
from services.mechanics.collision.kept import Kept
from services.mechanics.collision.motion_bounds import largest_gain
from services.mechanics.collision.primitives import index
from services.mechanics.collision.shell import REGION_WIDTH, Body, Patch, Regions
from services.mechanics.collision.tick import motion_between
from services.mechanics.compiled import inlined_kernel, kernel, summing_kernel
from services.mechanics.compiled.struct import Struct
from services.mechanics.compiled.vectors import (
    Vector,
    dot,
    put_row_of,
    row,
    row_of,
    squared_distance,
    subtract,
)

#: Triangles of a region, at most: what its vertices do against its middle is a fifth of what the wall does.
TRIANGLES = 160
#: Regions further than this beyond what a search has seen are bounded by the motion of any node.
SEARCH_MARGIN_M = 3e-3
#: Regions that a probe can have near it, and loaded nodes of a wall; with more there is no second opinion.
MOST = 48
MOST_LOADED = 256
_NONE = -1


class Near(Struct):
    """What n probes remember of the wall near them at their last search; good where `search` is the probe's."""

    search: Annotated[LongArray, "n"]
    count: Annotated[IntArray, "n"]  # regions, the closest first; `_NONE` without a second opinion
    place: Annotated[FloatArray, "n", 2, 3]  # ends
    q: Annotated[FloatArray, "n", "r"]  # modal coordinates
    n_loaded: Annotated[IntArray, "n"]
    loaded: Annotated[IntArray, "n", MOST_LOADED]  # loaded nodes
    loaded_by: Annotated[FloatArray, "n", MOST_LOADED, 3]  # and their residual displacements
    region: Annotated[IntArray, "n", MOST]
    room: Annotated[FloatArray, "n", MOST]  # by which it was further than what the search has seen
    has_before: Annotated[ByteArray, "n"]
    before: Annotated[FloatArray, "n", MOST, REGION_WIDTH]  # its numbers, filled in when first asked for

    @classmethod
    def allocate(cls, n: int, n_modes: int) -> Self:
        """Return what n probes without a past remember."""
        return cls.zeros(n=n, r=n_modes, search=np.full(n, _NONE, np.int64), count=np.full(n, _NONE, np.int32))


class Pieces(NamedTuple):
    """Regions and the boxes (c,) of the tree that are theirs."""

    regions: Regions
    boxes: IntArray


def build_regions(
    vertices_m: FloatArray, triangles: IntArray, tree: AabbTree, modes: FloatArray, omega_rad_s: FloatArray
) -> Pieces:
    """Cut the tree over triangles (m, 3) into regions that move by ``modes`` (n, 3, r)."""
    size = tree.span[:, 1] - tree.span[:, 0]
    inner = np.flatnonzero((tree.child[:, 0] != LEAF) & (size > TRIANGLES))
    roots = np.setdiff1d(np.union1d(tree.child[inner].ravel(), [0]), inner).astype(np.int32)
    members = [np.unique(triangles[tree.order[slice(*tree.span[root])]]) for root in roots]
    c = len(roots)
    shape, left = _moved_by(vertices_m, members, modes, omega_rad_s)
    count = np.bincount(np.concatenate(members), minlength=len(vertices_m))
    by_node = np.argsort(np.concatenate(members), kind="stable")
    of_node = np.repeat(np.arange(c, dtype=np.int32), [len(vertex) for vertex in members])[by_node]
    regions = Regions.zeros(
        c=c,
        shape=shape,
        left=left,
        of_node=of_node,
        first=np.concatenate([[0], np.cumsum(count)]).astype(np.int32),
        stamp=np.full(c, -1, np.int64),
        n=len(vertices_m),
    )
    return Pieces(regions, roots)


def _measured(
    vertices_m: FloatArray, members: list[IntArray], modes: FloatArray, omega_rad_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return rows (c, REGION_WIDTH, r) and what is left (c,) of regions with these vertices."""
    c, r = len(members), len(omega_rad_s)
    shape, left = np.zeros((c, REGION_WIDTH, r)), np.zeros(c)
    scaled_modes = modes / omega_rad_s
    for k, vertex in enumerate(members):
        middle = vertex[((vertices_m[vertex] - vertices_m[vertex].mean(axis=0)) ** 2).sum(axis=1).argmin()]
        shape[k, :3] = modes[middle]
        deformation, left[k] = _leading(scaled_modes[vertex] - scaled_modes[middle])
        shape[k, 3 : 3 + len(deformation)] = deformation * omega_rad_s
    return shape, left


_moved_by = Kept(_measured, 1)


def no_regions(n_nodes: int, n_modes: int) -> Regions:
    """Return the regions of a wall that has none: one whose sections turn, or that does not move."""
    return Regions.zeros(c=0, r=n_modes, m=0, n=n_nodes, first=np.zeros(n_nodes + 1, np.int32))


def _leading(modes: FloatArray) -> tuple[FloatArray, float]:
    """Return (k, r) rows B and t with |modes_i y| <= |B y| + t |y| for every vertex i of ``modes`` (v, 3, r)."""
    flat = modes.reshape(-1, modes.shape[2])
    energy, vectors = np.linalg.eigh(flat.T @ flat)
    k = min(REGION_WIDTH - 3, len(energy))
    value = np.sqrt(np.maximum(energy[::-1][:k], 0.0))
    V, value = vectors[:, ::-1][:, :k][:, value > 1e-9 * value[0]], value[value > 1e-9 * value[0]]
    gain = largest_gain(modes @ (V / value)).max()
    rows: FloatArray = gain * value[:, None] * V.T
    return rows, float(largest_gain(modes - (modes @ V) @ V.T).max())


@inlined_kernel
def note_near(body: Body, patch: Patch, near: Near, i: int, ends: tuple[Vector, Vector], seen: float) -> None:
    """Note where the wall near probe i is when a search there has seen all of it that is nearer than ``seen``."""
    regions = body.regions
    near.search[i], near.count[i], near.has_before[i] = body.searches, _NONE, 0
    if regions.left.shape[0] == 0 or near.q.shape[1] != body.q.shape[0] or body.n_loaded > MOST_LOADED:
        return
    for end in range(2):
        put_row_of(near.place, i, end, ends[end])
    for k in range(body.q.shape[0]):
        near.q[i, k] = body.q[k]
    near.n_loaded[i] = body.n_loaded
    for k in range(body.n_loaded):
        near.loaded[i, k] = body.loaded[k]
        put_row_of(near.loaded_by, i, k, row(body.residual, body.loaded[k]))
    near.count[i] = _find_near(body, patch, near, i, ends, seen)


@inlined_kernel
def _find_near(body: Body, patch: Patch, near: Near, i: int, ends: tuple[Vector, Vector], seen: float) -> int:
    """Note regions nearer than ``seen + SEARCH_MARGIN_M``, closest first; return how many, `_NONE` for too many."""
    boxes, stack, bound, limit2, count = patch.boxes, patch.stack, patch.bound, (seen + SEARCH_MARGIN_M) ** 2, 0
    stack[0], top = 0, 1
    bound[0] = distance2_below(body, patch, index(0), ends[0], ends[1], limit2, (0.0, 0.0, 0.0))
    while top > 0:
        top -= 1
        node, d2 = index(stack[top]), bound[top]
        if d2 >= limit2:
            continue
        if boxes[node, REGION] >= 0.0:
            if count == MOST:
                return _NONE
            _insert(near, i, count, index(boxes[node, REGION]), max(math.sqrt(d2) - seen, 0.0))
            count += 1
        elif not is_leaf(boxes, node):
            for column in range(CHILD, CHILD_RIGHT + 1):
                child = index(boxes[node, column])
                stack[top] = child
                bound[top] = distance2_below(body, patch, child, ends[0], ends[1], limit2, (0.0, 0.0, 0.0))
                top += 1
    return count


@kernel
def _insert(near: Near, i: int, count: int, region: int, room: float) -> None:
    """Append a region, or put it first where it is the closest so far."""
    place = count
    if count > 0 and room < near.room[i, 0]:
        near.region[i, count], near.room[i, count] = near.region[i, 0], near.room[i, 0]
        place = 0
    near.region[i, place], near.room[i, place] = region, room


@kernel
def used_since(body: Body, near: Near, i: int, ends: tuple[Vector, Vector], search: int) -> float:
    """Return how much of its slack probe i has used up since its last search; infinite where that is not known.

    Probe and wall count as seen from the closest region: what all of them do together changes nothing.
    """
    count = near.count[i]
    if count == _NONE or near.search[i] != search:
        return math.inf
    changed = _look_for_changes(body, near, i)
    _remember(body, near, i)
    moved, away = motion_between(body, body.q, near.q[i])
    used: float = _own(near, i, ends, (0.0, 0.0, 0.0)) + moved + changed - SEARCH_MARGIN_M
    if count == 0:
        return used
    carried = subtract(_middle(body, near.region[i, 0]), row_of(near.before, i, 0))
    own = _own(near, i, ends, carried)
    for k in range(count):
        used = max(used, own + _moved(body, near, (i, k), carried, away) - near.room[i, k])
    return used


@kernel
def _own(near: Near, i: int, ends: tuple[Vector, Vector], carried: Vector) -> float:
    """Return how far an end of probe i is from where it was, carried along."""
    moved = 0.0
    for end in range(2):
        was = row_of(near.place, i, end)
        moved = max(moved, squared_distance(ends[end], (was[0] + carried[0], was[1] + carried[1], was[2] + carried[2])))
    return math.sqrt(moved)


@kernel
def _moved(body: Body, near: Near, which: tuple[int, int], carried: Vector, away: float) -> float:
    """Return how far any vertex of a region (probe, which of those near it) has moved, carried along.

    ``away`` is |omega (q - q')|, with q' where the wall was.
    """
    regions, (i, k) = body.regions, which
    region = near.region[i, k]
    against = subtract(subtract(_middle(body, region), row_of(near.before, i, k)), carried)
    deformed = 0.0
    for number in range(3, REGION_WIDTH):
        deformed += (regions.now[region, number] - near.before[i, k, number]) ** 2
    apart = math.sqrt(dot(against, against)) + math.sqrt(deformed) + regions.left[region] * away
    moved: float = apart + regions.changed[region]
    return moved


@kernel
def _middle(body: Body, region: int) -> Vector:
    """Return the translation of a region in this tick, whose numbers are there then."""
    regions = body.regions
    if regions.stamp[region] != body.tick:
        regions.stamp[region] = body.tick
        _apply(regions, region, body.q, regions.now[region])
    return row(regions.now, region)


@kernel
def _remember(body: Body, near: Near, i: int) -> None:
    """Fill in the numbers that the regions near probe i had at its last search."""
    if not near.has_before[i]:
        near.has_before[i] = 1
        for k in range(near.count[i]):
            _apply(body.regions, near.region[i, k], near.q[i], near.before[i, k])


@summing_kernel
def _apply(regions: Regions, region: int, q: FloatArray, out: FloatArray) -> None:
    """Write the numbers of a region at modal coordinates q (r,) to ``out``."""
    shape = regions.shape
    for number in range(REGION_WIDTH):
        total = 0.0
        for k in range(q.shape[0]):
            total += shape[region, number, k] * q[k]
        out[number] = total


@kernel
def _look_for_changes(body: Body, near: Near, i: int) -> float:
    """Find by how much any residual of each region has changed since the last search of probe i; return the largest."""
    regions, largest = body.regions, 0.0
    for region in range(regions.left.shape[0]):
        regions.changed[region] = 0.0
    regions.asked += 1
    for k in range(near.n_loaded[i]):
        node = near.loaded[i, k]
        regions.asked_of[node] = regions.asked
        largest = max(largest, _enter(regions, node, subtract(row(body.residual, node), row_of(near.loaded_by, i, k))))
    for k in range(body.n_loaded):
        node = body.loaded[k]
        if regions.asked_of[node] != regions.asked:
            largest = max(largest, _enter(regions, node, row(body.residual, node)))
    return largest


@kernel
def _enter(regions: Regions, node: int, change: Vector) -> float:
    """Enter the change of a node's residual in its regions; return its length."""
    length = math.sqrt(dot(change, change))
    for place in range(regions.first[node], regions.first[node + 1]):
        region = regions.of_node[place]
        regions.changed[region] = max(regions.changed[region], length)
    return length
