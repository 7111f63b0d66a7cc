"""The candidate list (broad phase): for each piece, the triangles that it may touch before the next rebuild.

It is a Verlet list (L. Verlet, "Computer experiments on classical fluids", 1967). The list of a piece has the triangles
within its reach plus a skin. It is built from bounding spheres, which are larger by their *slack*, a bound on the
wall's motion since they were computed; those with too much slack are computed anew before a list is built from them. A
list that does not reach far enough where a step ends, because piece or wall were fast, is rebuilt there from the
spheres as they are, and at the next start if those are outdated.

Motion of the wall is measured from a reference configuration. A list *covers* the motion for which it was built: it is
complete until the piece's motion and what the wall's is beyond that are more than the skin. When the reference is
replaced, all slacks increase by the motion since the last one, and what lists cover decreases (triangle inequality).

Each entry also has a lower bound on its distance: the last measured distance minus the largest possible motion of piece
and wall since. Only entries whose bound is within reach are measured again, and only their nodes are placed. Entries
that may come within reach after a little more travel are listed apart, and only they are looked at in a tick.
"""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from trocar.services.mechanics.arrays import BoolArray, FloatArray, IntArray, LongArray
from trocar.services.mechanics.collision.clusters import (
    GROUP_CLUSTERS,
    Clusters,
    enclose,
    enclose_group,
    vector_from_segment,
)
from trocar.services.mechanics.compiled import inlined_kernel, kernel
from trocar.services.mechanics.compiled.struct import Struct
from trocar.services.mechanics.compiled.vectors import dot, put_row, put_row_of, row, row_of, squared_distance

#: A list is complete until piece and wall have moved by this. A thicker skin means longer lists, a thinner one more
#: frequent rebuilds.
SKIN_M = 0.5e-3
#: Motion of the wall after which the reference is replaced.
REFERENCE_M = 0.2e-3
#: Spheres with more slack are computed anew.
MAX_SLACK_M = 1e-3
#: Maximum number of entries of a piece: a shaft along all of a duct of 9,940 triangles lists 4,620 if it jumps by 2 mm.
MAX_ENTRIES = 8192
#: Travel of a piece and the wall until the piece's near entries are listed again: a few ticks of a moving hand.
NEAR_M = 0.2e-3
#: Gaps and overlaps of surfaces at rest are smaller. Candidates without a row may end a step no deeper than this, see
#: `simulation.step_solver`, and have none if they are further away.
TOUCHING_M = 30e-6
#: Motion of a piece in a step up to which its contacts are detected: 2 m/s, as fast as a catheter snaps.
LOOK_AHEAD_M = 2e-3
#: Motion of piece and wall in a step that lists allow for: 0.25 m/s, as fast as hands are.
REACH_M = 0.25e-3


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
    near: Annotated[IntArray, "p", MAX_ENTRIES]  # indices of the entries whose bound is at most ``near_bound``
    near_count: Annotated[LongArray, "p"]
    near_bound: Annotated[FloatArray, "p"]
    covered_m: Annotated[FloatArray, "p"]  # motion of the wall from the reference that the list allows for
    is_due: Annotated[BoolArray, "p"]  # whether the list is to be rebuilt at the start of a step
    listed_ends: Annotated[FloatArray, "p", 2, 3]
    last_ends: Annotated[FloatArray, "p", 2, 3]
    piece_travel: Annotated[FloatArray, "p"]  # sum of the longer motions of both ends
    first_position: Annotated[FloatArray, "n", 3]  # of the nodes when first placed after the reference, NaN before
    wanted: Annotated[FloatArray, "p"]  # gap up to which candidates are measured
    reach: Annotated[FloatArray, "p"]  # value of `wanted` up to which lists are complete while the skin lasts
    encloses: Annotated[BoolArray, "c"]  # whether the spheres of a cluster are to be computed anew
    known: Annotated[FloatArray, "m"]  # bounds of a list's entries while it is rebuilt, -infinity for other triangles
    before: Annotated[IntArray, MAX_ENTRIES]
    skin_m: float
    along_m: float  # further minima are candidates up to this much farther than the closest pair; none if below 0
    wall_travel: float = 0.0
    wall_moved_m: float = 0.0  # bound on the motion of any node between reference and start of the step
    start_moved_m: float = 0.0  # bound on its motion from the end of the last step to the start
    step_moved_m: float = 0.0  # bound on its motion since the end of the last step
    dropped: int = 0


@kernel
def add_travel(found: CandidateList, wall_moved_m: float) -> bool:
    """Add the motion of pieces since the last call, and a bound of the wall's, to their travel; return if any moved."""
    any_moved = wall_moved_m != 0.0
    found.wall_travel += wall_moved_m
    for p in range(found.count.shape[0]):
        moved_m = _furthest(found.ends, found.last_ends, p)
        any_moved = any_moved or moved_m > 0.0
        found.piece_travel[p] += moved_m
        copy_ends(found, p, found.last_ends)
    return bool(any_moved)


@kernel
def copy_ends(found: CandidateList, p: int, out: FloatArray) -> None:
    """Copy the ends of a piece into ``out`` (p, 2, 3)."""
    for end in range(2):
        put_row_of(out, p, end, row_of(found.ends, p, end))


@kernel
def set_wanted_gaps(found: CandidateList, start: FloatArray, ahead: FloatArray, wall_moved_m: float) -> None:
    """Request candidates up to a gap of ``ahead`` (p,), and further where something moves.

    Added is the piece's motion since ``start`` (p, 2, 3), through which it may have come to the other side. If that is
    more, added is what piece and wall approach by if they move on, at most `TOUCHING_M`. The wall has moved by at most
    ``wall_moved_m``.
    """
    for p in range(found.count.shape[0]):
        moved_m = _furthest(found.ends, start, p)
        found.wanted[p] = ahead[p] + max(min(moved_m, LOOK_AHEAD_M), min(moved_m + wall_moved_m, TOUCHING_M))
        found.reach[p] = ahead[p] + REACH_M


@kernel
def _furthest(ends: FloatArray, others: FloatArray, p: int) -> float:
    """Return the larger displacement of both ends of a piece between two sets of ends."""
    first_2 = squared_distance(row_of(ends, p, 0), row_of(others, p, 0))
    return math.sqrt(max(first_2, squared_distance(row_of(ends, p, 1), row_of(others, p, 1))))


@kernel
def note_placed(found: CandidateList, nodes: IntArray) -> None:
    """Include the motion of nodes (k,) that have been placed in the bound on the wall's motion."""
    largest_2 = found.wall_moved_m**2
    for k in range(nodes.shape[0]):
        at, first = row(found.position, nodes[k]), row(found.first_position, nodes[k])
        if math.isnan(first[0]):
            put_row(found.first_position, nodes[k], at)
        else:
            largest_2 = max(largest_2, squared_distance(at, first))
    found.wall_moved_m = math.sqrt(largest_2)


#: What `select_due` reports, as a sum: lists to rebuild, among them the first one of a piece, a new reference.
DUE, APPEARED, NEW_REFERENCE = 1, 2, 4


@kernel
def select_due(found: CandidateList, modes_moved_m: float) -> int:
    """Select the pieces whose lists are to be rebuilt, and the clusters near them with outdated spheres.

    ``modes_moved_m`` is a bound on the motion of any node by the modes from the reference.
    """
    report, found.wall_moved_m = 0, max(modes_moved_m, found.wall_moved_m)
    moved_m = found.wall_moved_m + found.start_moved_m
    if moved_m > REFERENCE_M:
        report = NEW_REFERENCE
        _increase(found.covered_m, -moved_m)
        _increase(found.clusters.slack_m, moved_m)
        found.first_position[:] = math.nan
        found.wall_moved_m = found.start_moved_m = found.step_moved_m = 0.0
    for p in range(found.count.shape[0]):
        is_used_up = not _used_m(found, p) <= found.skin_m  # also if it is no number
        found.is_due[p] = found.active[p] and (found.is_due[p] or is_used_up)
        if found.is_due[p]:
            report |= DUE | (APPEARED if found.covered_m[p] == -math.inf else 0)
            _select_outdated(found, p)
        elif not found.active[p]:
            found.covered_m[p] = -math.inf
            found.count[p] = found.near_count[p] = 0
    return report


@inlined_kernel
def _increase(values: FloatArray, by: float) -> None:
    for i in range(values.shape[0]):
        values[i] += by


@inlined_kernel
def _select_outdated(found: CandidateList, p: int) -> None:
    """Select the clusters within reach of a piece whose nodes may have moved too far since they were enclosed."""
    reach = found.thickness[p] + found.reach[p] + found.skin_m
    c = _next_within(found, p, 0, reach)
    while c < found.encloses.shape[0]:
        is_sound = found.clusters.slack_m[c] + found.wall_moved_m <= MAX_SLACK_M
        found.encloses[c] |= not is_sound  # also if it is no number
        c = _next_within(found, p, c + 1, reach)


@kernel
def _next_within(found: CandidateList, p: int, c: int, reach: float) -> int:
    """Return the first cluster from c on that may be within ``reach`` of the axis of a piece, or their number."""
    n: int = found.encloses.shape[0]
    while c < n:
        if c % GROUP_CLUSTERS == 0 and _is_beyond(found, p, n + c // GROUP_CLUSTERS, reach):
            c += GROUP_CLUSTERS
        elif _is_beyond(found, p, c, reach):
            c += 1
        else:
            return c
    return n


@kernel
def _is_beyond(found: CandidateList, p: int, sphere: int, reach: float) -> bool:
    """Return whether all triangles of a cluster or group are further than ``reach`` from the axis of a piece."""
    clusters, middle = found.clusters, row(found.clusters.sphere_middle, sphere)
    slack_m = clusters.slack_m[sphere] + found.wall_moved_m + found.step_moved_m
    far_m = reach + clusters.sphere_radius[sphere] + slack_m
    offset = vector_from_segment(row_of(found.ends, p, 0), row_of(found.ends, p, 1), middle)
    return bool(dot(offset, offset) > far_m * far_m)


@kernel
def rebuild_due(found: CandidateList) -> None:
    """Compute the spheres of the selected clusters, whose nodes have been placed, and rebuild the selected lists."""
    for c in range(found.encloses.shape[0]):
        if found.encloses[c]:
            enclose(found.clusters, c, found.position)
            found.clusters.slack_m[c] = found.wall_moved_m
    for c in range(found.encloses.shape[0]):
        if found.encloses[c]:
            enclose_group(found.clusters, c // GROUP_CLUSTERS)
            found.encloses[c - c % GROUP_CLUSTERS : c - c % GROUP_CLUSTERS + GROUP_CLUSTERS] = False
    for p in range(found.count.shape[0]):
        if found.is_due[p]:
            _list_piece(found, p)


@kernel
def complete_lists(found: CandidateList, wall_moved_m: float) -> None:
    """Rebuild the lists that do not reach far enough at the end of a step, in which the wall has moved so far."""
    found.step_moved_m = found.start_moved_m + wall_moved_m
    for p in range(found.count.shape[0]):
        if found.active[p] and not _used_m(found, p) + found.wanted[p] <= found.skin_m + found.reach[p]:
            _list_piece(found, p)


@kernel
def _used_m(found: CandidateList, p: int) -> float:
    """Return a bound on the motion of piece and wall beyond what the list allows for, infinite without a list."""
    moved_m = found.wall_moved_m + found.step_moved_m - found.covered_m[p]
    return float(moved_m + _furthest(found.ends, found.listed_ends, p))


@kernel
def _list_piece(found: CandidateList, p: int) -> None:
    """List the triangles within reach of a piece; bounds of those already listed are kept.

    A list built from outdated spheres is due at the next start.
    """
    a, b, clusters = row_of(found.ends, p, 0), row_of(found.ends, p, 1), found.clusters
    reach, n, n_before = max(found.reach[p], found.wanted[p]) + found.thickness[p] + found.skin_m, 0, found.count[p]
    travel, moved_m = found.wall_travel + found.piece_travel[p], found.wall_moved_m + found.step_moved_m
    found.is_due[p] = False
    for k in range(n_before):
        found.before[k], found.known[found.entry[p, k]] = found.entry[p, k], found.bound[p, k]
    c = _next_within(found, p, 0, reach)
    while c < found.encloses.shape[0]:
        found.is_due[p] |= clusters.slack_m[c] > MAX_SLACK_M
        slack_m = clusters.slack_m[c] + moved_m
        for place in range(clusters.first[c], clusters.first[c + 1]):
            t = clusters.order[place]
            offset = vector_from_segment(a, b, row(clusters.middle, t))
            distance = math.sqrt(dot(offset, offset)) - clusters.radius[t] - slack_m
            if distance > reach:
                continue
            if n == MAX_ENTRIES:
                found.dropped += 1
                continue
            found.entry[p, n], found.bound[p, n] = t, max(distance + travel, found.known[t])
            n += 1
        c = _next_within(found, p, c + 1, reach)
    for k in range(n_before):
        found.known[found.before[k]] = -math.inf
    found.count[p], found.covered_m[p], found.near_bound[p] = n, moved_m, -math.inf
    copy_ends(found, p, found.listed_ends)


@kernel
def list_near(found: CandidateList, p: int) -> float:
    """Return the largest bound with which the gap of an entry of a piece may be at most the wanted one.

    The near entries of the piece include all of these.
    """
    most = found.thickness[p] + found.wanted[p] + found.wall_travel + found.piece_travel[p]
    if most > found.near_bound[p]:
        found.near_bound[p], n = most + NEAR_M, 0
        for k in range(found.count[p]):
            if found.bound[p, k] <= most + NEAR_M:
                found.near[p, n] = k
                n += 1
        found.near_count[p] = n
    return float(most)


@kernel
def store_distance(found: CandidateList, p: int, k: int, distance_m: float) -> None:
    """Store the measured distance of an entry, or a lower bound on it."""
    found.bound[p, k] = distance_m + found.wall_travel + found.piece_travel[p]


def new_list(clusters: Clusters, position_m: FloatArray, n_pieces: int, along_m: float) -> CandidateList:
    """Return an empty list for ``n_pieces``, all inactive and without reach beyond their surface."""
    return CandidateList.zeros(
        clusters=clusters,
        position=position_m,
        p=n_pieces,
        n=len(position_m),
        c=len(clusters.first) - 1,
        m=len(clusters.triangles),
        covered_m=np.full(n_pieces, -math.inf),
        known=np.full(len(clusters.triangles), -math.inf),
        first_position=np.full_like(position_m, math.nan),
        skin_m=SKIN_M,
        along_m=along_m,
    )
