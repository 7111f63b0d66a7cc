"""The working set: the rule that selects the candidates which become contact rows.

A candidate gets a row if it touches, or would touch if all motions continued as in the last step. Candidates are chosen
by increasing clearance (the gap plus the indentation by jaws), members of the set first. A candidate whose position on
the undeformed wall and normal are near those of a chosen one of the same body is a duplicate, and gets no row, unless
it is deeper: a body would roll into the wall there, and be pushed out again. A feature (piece and triangle) whose
contact carried a force stays a member for some steps. Between squeezing jaws the closest pair need not have the
smallest clearance: a point that carried a force is a candidate in the next step too, because otherwise pricing would
have to find it in every step.
"""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from services.mechanics.arrays import ByteArray, FloatArray, IntArray, LongArray
from services.mechanics.collision.candidate_list import CandidateList, list_at
from services.mechanics.collision.candidates import Candidates, Where, candidates_at, nearest_to, offset, put
from services.mechanics.collision.pieces import N_TOOL_PIECES
from services.mechanics.compiled import inlined_kernel, kernel
from services.mechanics.compiled.struct import Address, Struct, reader
from services.mechanics.compiled.vectors import (
    Vector,
    combine,
    dot,
    put_row,
    row,
    squared_distance,
    subtract,
)
from services.mechanics.contact.clearance import overlap_in_jaws, piece_can_touch
from services.mechanics.contact.geometry import ContactGeometry, ToolGeometry, geometry_at

#: Smallest cosine between the normals of duplicates, 26 degrees.
SAME_NORMAL = 0.9
#: Smallest cosine between the normals of contacts on one flat facet, 2 degrees.
SAME_FACET = 0.9994
#: A contact is left out only if its clearance is at most this below what chosen ones imply: a tenth of what touches.
IMPLIED_M = 3e-6
#: Largest gap that counts as touching: gaps and overlaps of surfaces at rest are smaller. Candidates without a row may
#: end no deeper than this, see `simulation.step_solver`.
TOUCHING_M = 30e-6
#: Distance within which two points are the same, as a fraction of the axis's distance from the wall in contact.
SAME_POINT = 0.02
#: A step begins with rows for all members, and for the nearest other candidates up to this total; pricing finds the
#: rest. Assembling and solving so many rows costs about as much as pricing.
MAX_CHOSEN = 32
#: Steps for which a feature that no longer presses stays a member.
LIFE_STEPS = 3


class WorkingSet(Struct):
    """The members, which are features of p pieces and m triangles, and scratch for c candidates."""

    life: Annotated[ByteArray, "p", "m"]  # remaining steps of each member, 0 for other features
    member: Annotated[LongArray, "k", 2]  # the members: piece and triangle
    merge_m: Annotated[FloatArray, "p"]  # distance within which contacts of a piece are merged
    clearance_m: Annotated[FloatArray, "c"]  # gap plus the wall's indentation
    key: Annotated[FloatArray, "c"]
    order: Annotated[LongArray, "c"]
    chosen: Annotated[LongArray, "c"]
    at_rest: Annotated[FloatArray, "c", 3]
    rest: Annotated[FloatArray, "n", 3]
    pressed: Annotated[LongArray, "k", 2]  # features of squeezed wall that pressed in the last step, and their weights
    weight: Annotated[FloatArray, "k", 3]
    n_pressed: int = 0
    n_members: int = 0
    n_chosen: int = 0
    first_sphere: int = 0  # pieces from here on are spheres


set_at = reader(WorkingSet)


def new_working_set(
    rest_m: FloatArray, n_pieces: int, n_triangles: int, capacity: int, n_spheres: int = 0
) -> WorkingSet:
    """Return an empty set for candidates of ``n_pieces``, the last of them spheres, with a wall's triangles."""
    life = np.zeros((n_pieces, n_triangles), np.int8)
    extents = {"p": n_pieces, "m": n_triangles, "c": capacity, "k": capacity}
    rest, first_sphere = np.ascontiguousarray(rest_m), n_pieces - n_spheres
    return WorkingSet.zeros(life=life, rest=rest, first_sphere=first_sphere, **extents)


def merge_distance_m(thickness_m: FloatArray, wall_m: float) -> FloatArray:
    """Return the distances (p,), in m, within which two contacts of a piece are merged.

    At a distance of sqrt(r t / 2) from the contact a round body of radius r is a quarter of the wall's thickness t away
    from its tangent. Two such points are twice as far from each other. The result is at most half the radius.
    """
    apart: FloatArray = np.minimum(0.5 * thickness_m, np.sqrt(2.0 * wall_m * thickness_m))
    return apart


@kernel
def choose(
    addresses: tuple[Address[CandidateList], Address[Candidates], Address[WorkingSet]],
    before: Where,
    row_gap: FloatArray,
    geometry_address: Address[ContactGeometry],
) -> None:
    """Choose candidates for rows, and write their indices into ``chosen``, nearest first.

    A candidate is chosen if its clearance is at most ``row_gap`` (p,) of its piece, or would be after another step like
    the last one, which began at ``before``. Absent and disengaged tools get no rows.
    """
    listed, found, working = list_at(addresses[0]), candidates_at(addresses[1]), set_at(addresses[2])
    tools = geometry_at(geometry_address).tools
    for i in range(found.count):
        _rate_candidate(found, working, listed, tools, i)
    for k in range(working.n_pressed):
        _add_pressed(listed, found, working, tools, k)
    sort_by_key(working, found.count)
    working.n_chosen = 0
    for k in range(found.count):
        i = working.order[k]
        if working.n_chosen >= MAX_CHOSEN and not _is_member(found, working, i):
            break
        p = found.piece[i]
        if not piece_can_touch(tools, p):
            continue
        clearance_m = working.clearance_m[i]
        is_near = clearance_m <= row_gap[p] or clearance_m + _predicted_change_m(listed, found, before, i) <= row_gap[p]
        if is_near and not _is_duplicate(found, working, i):
            working.chosen[working.n_chosen] = i
            working.n_chosen += 1
    _leave_out_between(found, working)


@inlined_kernel
def _leave_out_between(found: Candidates, working: WorkingSet) -> None:
    """Leave out chosen candidates of a catheter's segment that two others, one on each side, imply.

    A straight segment touches a flat facet all along: two contacts say what the others would, and more rows than a
    contact has degrees of freedom make a solve slow.
    """
    kept, are_between = 0, working.order  # the order of candidates is not needed any more
    for k in range(working.n_chosen):
        are_between[k] = _is_between(found, working, working.chosen[k])
    for k in range(working.n_chosen):
        if not are_between[k]:
            working.chosen[kept] = working.chosen[k]
            kept += 1
    working.n_chosen = kept


@inlined_kernel
def _is_between(found: Candidates, working: WorkingSet, i: int) -> bool:
    """Return whether chosen candidates of the same segment and normal, one on each side, imply this one's clearance."""
    p, s, normal, before, after = found.piece[i], found.s[i], row(found.normal, i), -1, -1
    if not N_TOOL_PIECES <= p < working.first_sphere:
        return False
    for k in range(working.n_chosen):
        j = working.chosen[k]
        if found.piece[j] != p or dot(normal, row(found.normal, j)) < SAME_FACET:
            continue
        if found.s[j] < s and (before < 0 or found.s[j] < found.s[before]):
            before = j
        if found.s[j] > s and (after < 0 or found.s[j] > found.s[after]):
            after = j
    if before < 0 or after < 0:
        return False
    share = (s - found.s[before]) / (found.s[after] - found.s[before])
    implied_m = (1.0 - share) * working.clearance_m[before] + share * working.clearance_m[after]
    return bool(working.clearance_m[i] >= implied_m - IMPLIED_M)


@inlined_kernel
def _add_pressed(listed: CandidateList, found: Candidates, working: WorkingSet, tools: ToolGeometry, k: int) -> None:
    """Add a point that carried a force to the candidates, if it has less clearance than the closest pair."""
    p, t, w, nearest = working.pressed[k, 0], working.pressed[k, 1], row(working.weight, k), math.inf
    for i in range(found.count):
        if found.piece[i] == p and found.triangle[i] == t:
            nearest = min(nearest, working.clearance_m[i])
    if nearest == math.inf or found.count == found.gap_m.shape[0]:
        return
    distance, s, normal = nearest_to((listed.ends, listed.position), listed.clusters.triangles, (p, t), w)
    if distance > 0.0:
        put(found, (p, t), (distance - listed.thickness[p], s, w, normal))
        _rate_candidate(found, working, listed, tools, found.count - 1)
        found.count -= working.clearance_m[found.count - 1] >= nearest


@inlined_kernel
def _predicted_change_m(listed: CandidateList, found: Candidates, before: Where, i: int) -> float:
    """Return the change (m) of a gap in a step in which its points move as they have since ``before``."""
    place, corner = (found.piece[i], found.triangle[i]), listed.clusters.triangles
    s, w = found.s[i], row(found.weight, i)
    now = offset((listed.ends, listed.position), corner, place, s, w)
    return dot(row(found.normal, i), subtract(now, offset(before, corner, place, s, w)))


@kernel
def _rate_candidate(found: Candidates, working: WorkingSet, listed: CandidateList, tools: ToolGeometry, i: int) -> None:
    t, corner = found.triangle[i], listed.clusters.triangles
    put_row(working.at_rest, i, place_at_rest(working.rest, corner, t, row(found.weight, i)))
    working.clearance_m[i] = found.gap_m[i] + overlap_in_jaws(tools, found.piece[i], found.s[i], row(found.normal, i))
    working.key[i] = working.clearance_m[i] - (1.0 if _is_member(found, working, i) else 0.0)


@kernel
def _is_member(found: Candidates, working: WorkingSet, i: int) -> bool:
    return bool(working.life[found.piece[i], found.triangle[i]] > 0)


@kernel
def place_at_rest(rest: FloatArray, corner: IntArray, t: int, w: Vector) -> Vector:
    """Return the position of a point of a triangle on the undeformed wall."""
    return combine(w, row(rest, corner[t, 0]), row(rest, corner[t, 1]), row(rest, corner[t, 2]))


@inlined_kernel
def _is_duplicate(found: Candidates, working: WorkingSet, i: int) -> bool:
    """Return whether a chosen candidate represents this one."""
    near = working.merge_m[found.piece[i]]
    if _is_member(found, working, i):
        near = 2.0 * SAME_POINT * near
    return has_chosen_near(found, working, i, near)


@kernel
def has_chosen_near(found: Candidates, working: WorkingSet, i: int, near: float) -> bool:
    """Return whether a chosen one, as deep, has this one's body and normal, and is nearer than ``near`` at rest."""
    p, normal, place = found.piece[i], row(found.normal, i), row(working.at_rest, i)
    for k in range(working.n_chosen):
        other = working.chosen[k]
        if working.clearance_m[i] < working.clearance_m[other] - IMPLIED_M:
            continue
        is_alike = is_same_body(working, p, found.piece[other]) and dot(normal, row(found.normal, other)) >= SAME_NORMAL
        if is_alike and squared_distance(place, row(working.at_rest, other)) < near * near:
            return True
    return False


@inlined_kernel
def is_same_body(working: WorkingSet, p: int, other: int) -> bool:
    """Return whether contacts of two pieces may be one: of one piece, or of neighbours along the catheter."""
    if min(p, other) < N_TOOL_PIECES or max(p, other) >= working.first_sphere:
        return p == other
    return abs(p - other) <= 1


@kernel
def sort_by_key(working: WorkingSet, count: int) -> None:
    """Write the order of increasing keys (shell sort: no memory, and a few hundred candidates at most)."""
    key, order = working.key, working.order
    for i in range(count):
        order[i] = i
    step = 1
    while step < count // 3:
        step = 3 * step + 1
    while step >= 1:
        for i in range(step, count):
            moved, j = order[i], i
            while j >= step and key[order[j - step]] > key[moved]:
                order[j] = order[j - step]
                j -= step
            order[j] = moved
        step //= 3


@inlined_kernel
def age(working: WorkingSet) -> None:
    """Age all members by a step."""
    kept = 0
    for k in range(working.n_members):
        p, t = working.member[k, 0], working.member[k, 1]
        working.life[p, t] -= 1
        if working.life[p, t] > 0:
            working.member[kept, 0], working.member[kept, 1] = p, t
            kept += 1
    working.n_members = kept


@inlined_kernel
def renew(working: WorkingSet, p: int, t: int) -> None:
    """Make a feature a member with its full life."""
    if working.life[p, t] == 0:
        if working.n_members == working.member.shape[0]:
            return
        working.member[working.n_members, 0], working.member[working.n_members, 1] = p, t
        working.n_members += 1
    working.life[p, t] = LIFE_STEPS


@inlined_kernel
def store_pressed(working: WorkingSet, p: int, t: int, w: Vector) -> None:
    """Store the place of a feature that pressed beside its closest pair, for the next step."""
    if working.n_pressed < working.pressed.shape[0]:
        working.pressed[working.n_pressed, 0], working.pressed[working.n_pressed, 1] = p, t
        put_row(working.weight, working.n_pressed, w)
        working.n_pressed += 1


def forget(working: WorkingSet) -> None:
    """Forget all members."""
    working.life[:] = 0
    working.n_members = working.n_pressed = 0
