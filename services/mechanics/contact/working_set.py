"""The working set: the rule that selects the candidates which become contact rows.

A candidate gets a row if it touches or soon may; pricing finds those that come to touch within the step. Candidates are
chosen by increasing clearance (the gap plus the indentation by jaws), members of the set first. A candidate whose
position on the undeformed wall and normal are near those of a chosen one of the same body, and that is no deeper, is a
duplicate and gets no row. Members are the places, each on a feature (piece and triangle), whose contacts carried a
force within `LIFE_STEPS` steps. A piece along a triangle may press on it in two places, or touch it in a second one
beside the place that bears.
"""

from __future__ import annotations

import math
from typing import Annotated

from trocar.services.mechanics.arrays import ByteArray, FloatArray, IntArray, LongArray
from trocar.services.mechanics.bodies.forceps.tool_body import ToolArrays
from trocar.services.mechanics.collision.candidate_list import TOUCHING_M, CandidateList
from trocar.services.mechanics.collision.candidates import SAME_POINT, Candidates
from trocar.services.mechanics.collision.pieces import N_TOOL_PIECES
from trocar.services.mechanics.compiled import inlined_kernel, kernel
from trocar.services.mechanics.compiled.struct import Struct
from trocar.services.mechanics.compiled.vectors import Vector, combine, dot, put_row, row, squared_distance
from trocar.services.mechanics.contact.clearance import overlap_in_jaws, piece_can_touch

# Smallest cosine between the normals of duplicates, and of a row and what it covers, 26 degrees: a catheter touches
# facets of a tube meshed with 14 nodes around and more by one row, because they lie at less than that.
SAME_NORMAL = 0.9
#: On thin walls tolerances are at most this fraction of the thickness: four of them leave half of it.
SHARE_OF_WALL = 0.125
#: A contact is left out only if its clearance is at most this below that of the chosen one: a tenth of what touches. A
#: body would roll into the wall there, and be pushed out again. So near, there is a row even if nothing moves.
IMPLIED_M = 3e-6
#: A step begins with rows for all members, and for the nearest other candidates up to this total; pricing finds the
#: rest. Assembling and solving so many rows costs about as much as pricing.
MAX_CHOSEN = 32
#: Of the table's rows, those that a step may begin with: the rest is for effects, and for what pricing finds.
MOST_OF_TABLE = 0.75
#: Steps for which a feature that bears no more force stays a member. With one, a body that rocks on two features bears
#: on each in turn, because each is left out as a duplicate while the other bears. Three, because in a corner a body
#: may rock on three. Steps shorter than `FULL_STEP_S` count in part, because a body does not rock faster in them: a
#: wall under a jaw went on trembling by 10 um, in steps of 0.25 ms.
LIFE_STEPS, FULL_STEP_S = 3, 1e-3
NO_MEMBER = -1


class WorkingSet(Struct):
    """The members, which are on features of p pieces and m triangles, and scratch for c candidates."""

    places: Annotated[ByteArray, "p", "m"]  # how many members each feature has
    member: Annotated[LongArray, "c", 2]  # the members: piece and triangle
    life: Annotated[FloatArray, "c"]  # remaining steps of each member
    weight: Annotated[FloatArray, "c", 3]  # where on its triangle each member last carried a force
    member_of: Annotated[LongArray, "c"]  # which member a candidate is, or `NO_MEMBER`
    clearance_m: Annotated[FloatArray, "c"]  # gap plus the wall's indentation
    key: Annotated[FloatArray, "c"]
    order: Annotated[LongArray, "c"]
    chosen: Annotated[LongArray, "c"]
    at_rest: Annotated[FloatArray, "c", 3]
    rest: Annotated[FloatArray, "n", 3]
    n_members: int = 0
    n_chosen: int = 0
    wall_moved_m: float = 0.0  # largest motion of a candidate's node in the step, once it is priced
    first_sphere: int = 0  # pieces from here on are spheres


def tolerated_overlap_m(wall_m: float, n_steps: float = 1.0) -> float:
    """Return the overlap (m) that needs no row, with a wall this thick, at the end of a step as long as ``n_steps``."""
    return min(n_steps * TOUCHING_M, SHARE_OF_WALL * wall_m)


@kernel
def merge_distance_m(thickness_m: float, wall_m: float) -> float:
    """Return the distance, in m, within which two contacts of a piece are merged.

    At a distance of sqrt(r t / 2) from the contact a round body of radius r is a quarter of the wall's thickness t away
    from its tangent. Two such points are twice as far from each other. The result is at most half the radius.
    """
    return min(0.5 * thickness_m, math.sqrt(2.0 * wall_m * thickness_m))


@kernel
def choose(
    given: tuple[CandidateList, Candidates, WorkingSet], ahead: FloatArray, tools: ToolArrays, capacity: int
) -> None:
    """Choose candidates for rows, and write their indices into ``chosen``, nearest first.

    A candidate is chosen if its clearance is at most the gap wanted of its piece, and at most `TOUCHING_M` more than
    ``ahead`` (p,). Absent and disengaged tools get no rows. The table has ``capacity`` rows.
    """
    (listed, found, working), n = given, 0
    for i in range(found.count):
        p = found.piece[i]
        if not piece_can_touch(tools, p):
            continue
        clearance_m = found.gap_m[i] + overlap_in_jaws(tools, p, found.s[i], row(found.normal, i))
        if clearance_m <= min(listed.wanted[p], ahead[p] + TOUCHING_M):
            enter(found, working, listed.clusters.triangles, (n, i), (clearance_m, clearance_m))
            n += 1
    _find_members(found, working, n)
    sort_by_key(working, n)
    working.n_chosen, working.wall_moved_m = 0, 0.0
    for k in range(n):
        i = working.order[k]
        is_member = working.member_of[i] != NO_MEMBER
        if working.n_chosen >= (MOST_OF_TABLE * capacity if is_member else MAX_CHOSEN):
            break
        # A duplicate is nearer than contacts merge or, for a member, at the same place.
        near = merge_distance_m(listed.thickness[found.piece[i]], tools.wall_thickness)
        if not has_chosen_near(found, working, i, 2.0 * SAME_POINT * near if is_member else near):
            working.chosen[working.n_chosen] = i
            working.n_chosen += 1


@kernel
def enter(
    found: Candidates, working: WorkingSet, corner: IntArray, entry: tuple[int, int], given: tuple[float, float]
) -> None:
    """Write a candidate before sorting: ``entry`` is (slot in ``order``, candidate), ``given`` (clearance, key)."""
    slot, i = entry
    working.order[slot] = i
    working.clearance_m[i], working.key[i] = given
    put_row(working.at_rest, i, place_at_rest(working.rest, corner, found.triangle[i], row(found.weight, i)))


@inlined_kernel
def _find_members(found: Candidates, working: WorkingSet, count: int) -> None:
    """Find which member each of the first ``count`` of ``order`` is, and let members come first.

    A member is the nearest candidate on its feature. Of a catheter or a stone all are, because what slides fast comes
    from one place on a triangle to the next within a step.
    """
    for slot in range(count):
        working.member_of[working.order[slot]] = NO_MEMBER
    for k in range(working.n_members):
        p, nearest, least_2 = working.member[k, 0], NO_MEMBER, math.inf
        for slot in range(count):
            i = working.order[slot]
            if found.piece[i] != p or found.triangle[i] != working.member[k, 1]:
                continue
            apart_2 = squared_distance(row(found.weight, i), row(working.weight, k))
            if p >= N_TOOL_PIECES:
                _make_member(working, i, k)
            elif apart_2 < least_2:
                nearest, least_2 = i, apart_2
        if nearest != NO_MEMBER:
            _make_member(working, nearest, k)


@kernel
def _make_member(working: WorkingSet, i: int, k: int) -> None:
    """Let a candidate be a member, unless it is another one."""
    if working.member_of[i] == NO_MEMBER:
        working.member_of[i] = k
        working.key[i] -= 1.0


@kernel
def place_at_rest(rest: FloatArray, corner: IntArray, t: int, w: Vector) -> Vector:
    """Return the position of a point of a triangle on the undeformed wall."""
    return combine(w, row(rest, corner[t, 0]), row(rest, corner[t, 1]), row(rest, corner[t, 2]))


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
    """Sort the first ``count`` of ``order`` by increasing keys, and by indices where keys are equal, as on an edge.

    Shell sort: no memory, and a few hundred candidates at most.
    """
    key, order, step = working.key, working.order, 1
    while step < count // 3:
        step = 3 * step + 1
    while step >= 1:
        for i in range(step, count):
            moved, j = order[i], i
            while j >= step and (key[order[j - step]], order[j - step]) > (key[moved], moved):
                order[j] = order[j - step]
                j -= step
            order[j] = moved
        step //= 3


@inlined_kernel
def age_members(working: WorkingSet, dt_s: float) -> None:
    """Age all members by a step of ``dt_s``, and remove those whose life is over."""
    n_left, age = 0, min(dt_s / FULL_STEP_S, 1.0)
    for k in range(working.n_members):
        life = working.life[k] - age
        if life > 0.0:
            working.member[n_left], working.weight[n_left] = working.member[k], working.weight[k]
            working.life[n_left] = life
            n_left += 1
        else:
            working.places[working.member[k, 0], working.member[k, 1]] -= 1
    working.n_members = n_left


@inlined_kernel
def renew_member(working: WorkingSet, p: int, t: int, weight: Vector) -> None:
    """Give the member nearest to a place on a feature its full life there, or make it one if there is room for more.

    Each place that carries a force in a step has a member of its own: those with a full life are taken.
    """
    nearest, least_2 = NO_MEMBER, math.inf
    for k in range(working.n_members if working.places[p, t] > 0 else 0):
        if working.member[k, 0] == p and working.member[k, 1] == t and working.life[k] < LIFE_STEPS:
            apart_2 = squared_distance(weight, row(working.weight, k))
            if apart_2 < least_2:
                nearest, least_2 = k, apart_2
    if nearest == NO_MEMBER:
        if working.n_members == working.member.shape[0]:
            return
        nearest = working.n_members
        working.n_members += 1
        working.places[p, t] += 1
        working.member[nearest, 0], working.member[nearest, 1] = p, t
    working.life[nearest] = LIFE_STEPS
    put_row(working.weight, nearest, weight)
