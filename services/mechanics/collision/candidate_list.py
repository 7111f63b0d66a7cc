"""The candidate list (broad phase): for each piece, the triangles that it may touch before the next rebuild.

It is a Verlet list (L. Verlet, "Computer experiments on classical fluids", 1967). The list of a piece has the triangles
within its reach plus a skin, and is complete until piece and wall together have moved by the skin. A piece that has
moved rebuilds its own list; only motion of the wall rebuilds all lists.

Each entry also has a lower bound on its distance: the last measured distance minus the largest possible motion of piece
and wall since. Only entries whose bound is within reach are measured again, and only their nodes are placed.
"""

from __future__ import annotations

import math
from typing import Annotated

from services.mechanics.arrays import BoolArray, FloatArray, IntArray, LongArray
from services.mechanics.collision.clusters import Clusters, vector_from_segment
from services.mechanics.compiled import inlined_kernel, kernel
from services.mechanics.compiled.struct import Address, Struct, reader
from services.mechanics.compiled.vectors import dot, put_row_of, row, row_of, squared_distance

#: Maximum number of entries of a piece: a tool's shaft lies along a third of a duct of 40 mm.
MAX_ENTRIES = 768
#: Motion of a piece in a step up to which its contacts are detected: 2 m/s, as fast as a catheter snaps.
LOOK_AHEAD_M = 2e-3


class CandidateList(Struct):
    """Lists of p pieces, each a capsule, against the m triangles of a wall of n nodes."""

    clusters: Clusters
    position: Annotated[FloatArray, "n", 3]  # of the nodes, as last placed
    ends: Annotated[FloatArray, "p", 2, 3]  # of the pieces now
    thickness: Annotated[FloatArray, "p"]  # distance of axis and mid-surface at which a piece touches the wall
    active: Annotated[BoolArray, "p"]
    entry: Annotated[IntArray, "p", MAX_ENTRIES]
    bound: Annotated[FloatArray, "p", MAX_ENTRIES]  # of the distance, plus `travel` of wall and piece then
    count: Annotated[LongArray, "p"]
    is_listed: Annotated[BoolArray, "p"]
    listed_ends: Annotated[FloatArray, "p", 2, 3]
    last_ends: Annotated[FloatArray, "p", 2, 3]
    piece_travel: Annotated[FloatArray, "p"]  # sum of the longer motions of both ends
    node: Annotated[IntArray, "n"]  # those of listed triangles, each once
    mark: Annotated[LongArray, "n"]
    listed_position: Annotated[FloatArray, "n", 3]  # of all nodes when the wall's lists were renewed
    wanted: Annotated[FloatArray, "p"]  # gap up to which candidates are measured
    reach: Annotated[FloatArray, "p"]  # largest value of `wanted` before the lists are rebuilt
    skin_m: float
    along_m: float  # further minima are candidates up to this much farther than the closest pair; none if below 0
    wall_travel: float = 0.0
    n_nodes: int = 0
    stamp: int = 0
    dropped: int = 0


list_at = reader(CandidateList)


@kernel
def add_travel(address: Address[CandidateList], wall_moved_m: float) -> bool:
    """Add the motion of pieces since the last call, and a bound of the wall's, to their travel; return if any moved."""
    found, any_moved = list_at(address), wall_moved_m != 0.0
    found.wall_travel += wall_moved_m
    for p in range(found.count.shape[0]):
        moved_m = _furthest(found.ends, found.last_ends, p)
        any_moved = any_moved or moved_m > 0.0
        found.piece_travel[p] += moved_m
        _copy_ends(found, p, found.last_ends)
    return bool(any_moved)


@kernel
def _copy_ends(found: CandidateList, p: int, out: FloatArray) -> None:
    for end in range(2):
        put_row_of(out, p, end, row_of(found.ends, p, end))


@kernel
def set_wanted_gaps(address: Address[CandidateList], start: FloatArray, ahead: FloatArray) -> None:
    """Request candidates up to a gap of ``ahead`` (p,) plus each piece's motion since ``start`` (p, 2, 3), in m."""
    found = list_at(address)
    for p in range(found.count.shape[0]):
        found.wanted[p] = ahead[p] + min(_furthest(found.ends, start, p), LOOK_AHEAD_M)
        found.reach[p] = ahead[p] + LOOK_AHEAD_M


@kernel
def _furthest(ends: FloatArray, others: FloatArray, p: int) -> float:
    """Return the larger displacement of both ends of a piece between two sets of ends."""
    first_2 = squared_distance(row_of(ends, p, 0), row_of(others, p, 0))
    return math.sqrt(max(first_2, squared_distance(row_of(ends, p, 1), row_of(others, p, 1))))


@inlined_kernel
def _listed_wall_moved_m(found: CandidateList) -> float:
    """Return the largest displacement of a listed node since the wall's lists were rebuilt."""
    largest_2 = 0.0
    for k in range(found.n_nodes):
        node = found.node[k]
        largest_2 = max(largest_2, squared_distance(row(found.position, node), row(found.listed_position, node)))
    return math.sqrt(largest_2)


#: Outcomes of `renew_lists`: nothing to do, lists of pieces rebuilt, nothing done because the wall has moved too far.
SAME, RENEWED, WALL_MOVED_TOO_FAR = 0, 1, 2


@kernel
def renew_lists(address: Address[CandidateList], modes_moved_m: float, most_m: float) -> int:
    """Rebuild the lists of pieces that have moved too far, unless the wall has moved by more than ``most_m``.

    ``modes_moved_m`` is a bound on the motion of any node by the modes. Bounding spheres are those of the last rebuild
    of all lists.
    """
    found, any_new = list_at(address), False
    wall_moved_m = max(modes_moved_m, _listed_wall_moved_m(found))
    if wall_moved_m > most_m:
        return WALL_MOVED_TOO_FAR
    for p in range(found.count.shape[0]):
        if not found.active[p]:
            found.is_listed[p] = False
            found.count[p] = 0
        elif not found.is_listed[p] or _furthest(found.ends, found.listed_ends, p) + wall_moved_m > found.skin_m:
            _list_piece(found, p, wall_moved_m)
            any_new = True
    if any_new:
        _list_nodes(found)
        return RENEWED
    return SAME


@inlined_kernel
def _list_piece(found: CandidateList, p: int, wall_moved_m: float) -> None:
    """List the triangles within reach of a piece; ``wall_moved_m`` is the motion since spheres were computed."""
    a, b, clusters = row_of(found.ends, p, 0), row_of(found.ends, p, 1), found.clusters
    reach, n = found.thickness[p] + found.reach[p] + found.skin_m, 0
    travel = found.wall_travel + found.piece_travel[p]
    for c in range(clusters.cluster_radius.shape[0]):
        far_m = reach + clusters.cluster_radius[c]
        offset = vector_from_segment(a, b, row(clusters.cluster_middle, c))
        if dot(offset, offset) > far_m * far_m:
            continue
        for place in range(clusters.first[c], clusters.first[c + 1]):
            t = clusters.order[place]
            offset = vector_from_segment(a, b, row(clusters.middle, t))
            distance = math.sqrt(dot(offset, offset)) - clusters.radius[t]
            if distance > reach:
                continue
            if n == MAX_ENTRIES:
                found.dropped += 1
                continue
            found.entry[p, n], found.bound[p, n] = t, distance - wall_moved_m + travel
            n += 1
    found.count[p], found.is_listed[p] = n, True
    _copy_ends(found, p, found.listed_ends)


@inlined_kernel
def _list_nodes(found: CandidateList) -> None:
    found.stamp += 1
    n, corner = 0, found.clusters.triangles
    for p in range(found.count.shape[0]):
        for k in range(found.count[p]):
            for c in range(3):
                node = corner[found.entry[p, k], c]
                if found.mark[node] != found.stamp:
                    found.mark[node] = found.stamp
                    found.node[n] = node
                    n += 1
    found.n_nodes = n


@kernel
def largest_bound(found: CandidateList, p: int) -> float:
    """Return the largest bound with which the gap of an entry of a piece may be at most the wanted one."""
    return float(found.thickness[p] + found.wanted[p] + found.wall_travel + found.piece_travel[p])


@kernel
def store_distance(found: CandidateList, p: int, k: int, distance_m: float) -> None:
    """Store the measured distance of an entry, or a lower bound on it."""
    found.bound[p, k] = distance_m + found.wall_travel + found.piece_travel[p]


def new_list(clusters: Clusters, position_m: FloatArray, n_pieces: int, skin_m: float, along_m: float) -> CandidateList:
    """Return an empty list for ``n_pieces``, all inactive and without reach beyond their surface."""
    return CandidateList.zeros(
        clusters=clusters,
        position=position_m,
        p=n_pieces,
        n=len(position_m),
        listed_position=position_m.copy(),
        skin_m=skin_m,
        along_m=along_m,
    )
