"""Candidates between pieces of bodies and a wall, with lists that persist from tick to tick, for physics and haptics.

A tick calls `follow_wall` after it has written the pieces, and then `measure` as often as necessary.
"""

from __future__ import annotations

import math

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.collision.candidate_list import (
    APPEARED,
    DUE,
    NEW_REFERENCE,
    CandidateList,
    add_travel,
    complete_lists,
    list_near,
    new_list,
    note_placed,
    rebuild_due,
    select_due,
    set_wanted_gaps,
)
from trocar.services.mechanics.collision.candidates import Candidates, write_closest
from trocar.services.mechanics.collision.clusters import Clusters, cluster_triangles
from trocar.services.mechanics.collision.placed_wall import (
    Loads,
    PlacedWall,
    bound_since,
    configure,
    place_requested,
    place_wall,
    request_node,
    tightened_m,
)
from trocar.services.mechanics.collision.wall_bounds import WallBounds, bound_between, set_reference, wall_bounds
from trocar.services.mechanics.compiled import inlined_kernel, kernel
from trocar.services.mechanics.compiled.struct import Struct, reader
from trocar.services.mechanics.reduction.reduced_duct import ReducedDuct


class WallCandidates(Struct):
    """Lists of the pieces against a wall; a caller writes ``ends``, ``thickness``, ``active`` and ``reach`` of them."""

    list: CandidateList
    wall: PlacedWall
    bounds: WallBounds  # from the reference of the lists
    is_new: bool = True  # whether the next tick begins with empty lists


candidates_of = reader(WallCandidates)


def wall_candidates(
    duct: ReducedDuct, n_pieces: int, along_m: float, like: WallCandidates | None = None
) -> WallCandidates:
    """Return empty lists for ``n_pieces`` and the wall of a duct, or of other lists; ``along_m``: `CandidateList`."""
    wall = place_wall(duct) if like is None else like.wall
    bounds = wall_bounds(duct, wall.bounds) if like is None else like.bounds
    clusters = cluster_triangles(duct.mesh.vertices_m, duct.mesh.triangles) if like is None else like.list.clusters
    return WallCandidates(list=new_list(clusters, wall.position, n_pieces, along_m), wall=wall, bounds=bounds)


@kernel
def follow_wall(known: WallCandidates, q: FloatArray, loads: Loads) -> bool:
    """Set the coordinates q (r,) and loads at the start of a step, and rebuild the lists of pieces that have moved far.

    Return whether anything has changed since the last measurement; if not, its candidates are still valid.
    """
    listed, wall = known.list, known.wall
    moved_m = tightened_m(wall, configure(wall, q, loads, (wall.load_node[:0], wall.load_force[:0])))
    modes_moved_m = math.inf if known.is_new else bound_between(known.bounds, wall.bounds, 0.0)
    is_elsewhere = add_travel(listed, moved_m)
    if known.is_new:  # remove all entries, and have all spheres computed anew; a bound may be no number
        listed.count[:], listed.piece_travel[:], listed.wall_travel = 0, 0.0, 0.0
        listed.covered_m[:], listed.clusters.slack_m[:], listed.wall_moved_m = -math.inf, math.inf, 0.0
        moved_m = 0.0
    listed.start_moved_m = listed.step_moved_m = moved_m
    report = select_due(listed, modes_moved_m)
    if report & DUE:
        _request_enclosed(known)
        place_requested(wall)
        rebuild_due(listed)
    if report & NEW_REFERENCE:
        set_reference(known.bounds, q)
        known.is_new = False
    return bool(is_elsewhere or report & APPEARED)


@inlined_kernel
def _request_enclosed(known: WallCandidates) -> None:
    """Request the nodes of the clusters whose spheres are to be computed anew."""
    clusters = known.list.clusters
    for c in range(known.list.encloses.shape[0]):
        if known.list.encloses[c]:
            for entry in range(clusters.first[c], clusters.first[c + 1]):
                request_triangle(known.wall, clusters, clusters.order[entry])


@kernel
def follow_end(
    known: WallCandidates,
    q: FloatArray,
    loads: tuple[Loads, Loads],
    start: tuple[PlacedWall, FloatArray],
    ahead: FloatArray,
) -> None:
    """Set coordinates, loads and lasting loads at the end of a step, and what is wanted there.

    ``start`` is the wall at the start, and the ends (p, 2, 3) of the pieces, which `set_wanted_gaps` takes as ``ahead``
    (p,). Only incomplete lists are rebuilt.
    """
    add_travel(known.list, tightened_m(known.wall, configure(known.wall, q, loads[0], loads[1])))
    moved_m = bound_since(known.wall, start[0])
    set_wanted_gaps(known.list, start[1], ahead, moved_m)
    complete_lists(known.list, moved_m)


@kernel
def measure(known: WallCandidates, out: Candidates) -> None:
    """Write the closest pairs with a gap up to ``wanted``."""
    listed, wall = known.list, known.wall
    for p in range(listed.count.shape[0]):
        most = list_near(listed, p)
        for place in range(listed.near_count[p]):
            k = listed.near[p, place]
            if listed.bound[p, k] <= most:
                request_triangle(wall, listed.clusters, listed.entry[p, k])
    place_requested(wall)
    note_placed(listed, wall.requested[: wall.n_requested])
    write_closest(listed, out)


@kernel
def request_triangle(wall: PlacedWall, clusters: Clusters, t: int) -> None:
    """Request the nodes of a triangle."""
    for c in range(3):
        request_node(wall, clusters.triangles[t, c])
