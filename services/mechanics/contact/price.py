"""Pricing of candidates (constraint generation): it finds those that need a row because they end the step too deep.

The closest distances of all candidates are measured at the end of the solved step, less the overlap that squeezing jaws
allow. A candidate that ends deeper than a tolerance, at a place without a row, gets a row with its points at the end,
and the solve continues. So the complementarity problem is solved with the rows that matter, and the others are
known to be satisfied.
"""

from __future__ import annotations

import math

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.bodies.forceps.tool_body import ToolArrays
from trocar.services.mechanics.collision.candidate_list import CandidateList
from trocar.services.mechanics.collision.candidates import (
    SAME_POINT,
    Candidates,
    Where,
    closest_pair,
    nearest_to,
    offset,
    put,
)
from trocar.services.mechanics.collision.capsules import (
    NO_END,
    CapsuleMemory,
    ends_of,
    free_ends,
    measure_pair,
    vector_between,
)
from trocar.services.mechanics.collision.pairs import (
    CATHETER_SEGMENT,
    DUCT_TRIANGLE,
    JAW_A,
    NO_TOOL,
    SHAFT,
    ContactPairs,
    write_pair,
)
from trocar.services.mechanics.collision.pieces import N_TOOL_PIECES, owner_of, write_piece_pair
from trocar.services.mechanics.collision.strands import first_target, is_of_neighbour
from trocar.services.mechanics.compiled import inlined_kernel, kernel
from trocar.services.mechanics.compiled.vectors import Vector, dot, row, row_of, scaled, squared_distance, unit
from trocar.services.mechanics.contact.clearance import jaw_surface, overlap_in_jaws, piece_can_touch
from trocar.services.mechanics.contact.identity import PARTICLE, SEGMENT, pair_identity, part_of, without_target
from trocar.services.mechanics.contact.rows import ContactRows
from trocar.services.mechanics.contact.state import ContactState
from trocar.services.mechanics.contact.working_set import (
    IMPLIED_M,
    SAME_NORMAL,
    WorkingSet,
    enter,
    has_chosen_near,
    place_at_rest,
    sort_by_key,
)
from trocar.services.mechanics.contact.writer import n_free_rows

#: Depth beyond which a piece has no reliable normal, as a fraction of its axis's distance from the wall in contact.
UNRELIABLE_DEPTH = 0.5
#: Where a piece is deeper than so many tolerances, a row is corrected by whatever the step ends deeper than the row
#: predicts, but for rounding (m): it would go on creeping. Elsewhere only if that is more than `IMPLIED_M`.
MARGIN, ROUNDING_M = 2.0, 1e-7
#: Distance within which violations share a row, as a fraction of the axis's distance from the wall in contact.
VIOLATION_SPACING = 0.1
# Maximum number of rows that a pricing adds, the deepest first; the others are priced again, because the first
# ones may hold them off.
MAX_NEW_ROWS = 24

Found = tuple[Candidates, Candidates]
"""Candidates at the end of the step, and room for those of them that end too deep."""


@kernel
def write_violations(
    given: tuple[CandidateList, Found, WorkingSet, ContactState], start: Where, tolerance_m: float, pairs: ContactPairs
) -> int:
    """Write only pairs of the candidates that end too deep, the deepest at each place, and correct rows at such places.

    Return the number of both.

    Candidates have been measured at the end of the step; ``start`` is its start. If there is no room for a row, return
    the number of violations.
    """
    listed, (all_found, found), working, state = given
    pairs.count = pairs.dropped = 0
    working.wall_moved_m = _furthest_node(listed, all_found, start[1])
    most = min(MAX_NEW_ROWS, n_free_rows(state.rows))
    n = _find_violations(listed, (all_found, found), state, start, tolerance_m)
    for i in range(n):
        enter(found, working, listed.clusters.triangles, (i, i), (found.gap_m[i], found.gap_m[i]))
    sort_by_key(working, n)
    working.n_chosen = n_corrected = 0
    for place in range(n):
        i = working.order[place]
        near = VIOLATION_SPACING * listed.thickness[found.piece[i]]
        covering, corrected = _correct_rows(listed, found, working, state, (i, MARGIN * tolerance_m))
        n_corrected += corrected
        if working.n_chosen < most and not (has_chosen_near(found, working, i, near) or covering > 0):
            working.chosen[working.n_chosen] = i
            working.n_chosen += 1
            _write_violation(listed, found, i, start, (state.geometry.tools, pairs))
    return int(working.n_chosen + n_corrected if most > 0 else n)


@inlined_kernel
def _furthest_node(listed: CandidateList, found: Candidates, start: FloatArray) -> float:
    """Return the largest distance (m) of a node of a candidate from where it was in ``start`` (n, 3)."""
    largest_2 = 0.0
    for i in range(found.count):
        for c in range(3):
            node = listed.clusters.triangles[found.triangle[i], c]
            largest_2 = max(largest_2, squared_distance(row(listed.position, node), row(start, node)))
    return math.sqrt(largest_2)


@inlined_kernel
def _find_violations(
    listed: CandidateList, candidates: Found, state: ContactState, start: Where, tolerance_m: float
) -> int:
    """Copy the candidates that end too deep; ``gap_m`` becomes the gap at the end plus the allowed overlap."""
    (found, out), tools = candidates, state.geometry.tools
    out.count = 0
    for i in range(found.count):
        if found.gap_m[i] >= -tolerance_m:
            continue
        p, t = found.piece[i], found.triangle[i]
        if not piece_can_touch(tools, p):
            continue
        normal = row(found.normal, i)
        end = found.gap_m[i] + overlap_in_jaws(tools, p, found.s[i], normal)
        if end >= -tolerance_m:
            continue
        before = closest_pair(start, listed.clusters.triangles, (p, t))[3]
        if found.gap_m[i] < -UNRELIABLE_DEPTH * listed.thickness[p] or dot(normal, before) < 0.0:
            # The axis is at or beyond the middle surface: the piece must stay on the side of the start.
            normal, ends = before, (listed.ends, listed.position)
            away = offset(ends, listed.clusters.triangles, (p, t), found.s[i], row(found.weight, i))
            end = dot(before, away) - listed.thickness[p]
            if end >= -tolerance_m:
                continue
        put(out, (p, t), (end, found.s[i], row(found.weight, i), normal))
    return out.count


@inlined_kernel
def _correct_row(rows: ContactRows, motion: FloatArray, at: int, end_m: float, most_m: float) -> int:
    """Correct a row by what the step ends deeper than it predicts; return 1 if it was, else 0.

    A row is linear in the motion of the bodies: the difference is added to its gap (second-order correction of
    constraints, Nocedal and Wright, "Numerical Optimization", 18.3). ``end_m`` is the gap at the end of the step, with
    the rest offset; beyond a depth of ``most_m`` only rounding is left uncorrected.
    """
    begun = rows.gap_m[at] + rows.rest_offset_m[at] + rows.correction_m[at]
    deeper = end_m - (begun + motion[3 * at] - rows.effective_gap_m[at])
    if deeper < -(IMPLIED_M if end_m >= -most_m else ROUNDING_M):
        rows.correction_m[at] += deeper
        return 1
    return 0


@inlined_kernel
def _correct_rows(
    listed: CandidateList, found: Candidates, working: WorkingSet, state: ContactState, violation: tuple[int, float]
) -> tuple[int, int]:
    """Return how many rows cover a violation, and how many of them have been corrected.

    ``violation`` is (its index, the depth in m beyond which nothing may deepen).

    A row covers it that has the same points, on any triangle, and nearly the same normal.
    """
    i, most_m = violation
    p, t, rows, motion = found.piece[i], found.triangle[i], state.rows, state.problem.motion
    identity = without_target(pair_identity(*owner_of(p), DUCT_TRIANGLE, t))
    normal = jaw_surface(state.geometry.tools, p, found.s[i], row(found.normal, i))[3]
    near, place, covering, corrected = SAME_POINT * listed.thickness[p], row(working.at_rest, i), 0, 0
    for at in range(rows.n_contacts):
        if without_target(rows.identity[at]) == identity and dot(row(rows.frame[at], 0), normal) > SAME_NORMAL:
            known = place_at_rest(working.rest, rows.duct_node, at, row(rows.duct_weight, at))
            if squared_distance(place, known) < near * near:
                covering += 1
                corrected += _correct_row(rows, motion, at, found.gap_m[i], most_m)
    return covering, corrected


@kernel
def piece_of(rows: ContactRows, at: int) -> int:
    """Return the piece of a row that is a contact with the wall."""
    identity = rows.identity[at]
    if rows.tool[at] != NO_TOOL:
        return int(3 * rows.tool[at] + part_of(identity, SEGMENT))
    return int(N_TOOL_PIECES + part_of(identity, PARTICLE) - 1)


@inlined_kernel
def _write_violation(
    listed: CandidateList, found: Candidates, i: int, start: Where, to: tuple[ToolArrays, ContactPairs]
) -> None:
    """Write a violation as a pair with the gap at the end of the step.

    At a corner a pair may seem to overlap at the start along the normal of the end, although it does not. Then the
    normal between its points at the start is used.
    """
    p, t, s, w, normal = found.piece[i], found.triangle[i], found.s[i], row(found.weight, i), row(found.normal, i)
    away = offset(start, listed.clusters.triangles, (p, t), s, w)
    distance = math.sqrt(dot(away, away))
    if overlap_in_jaws(to[0], p, s, normal) > 0.0:
        s, normal = nearest_to(start, listed.clusters.triangles, (p, t), w)
    elif dot(away, normal) < listed.thickness[p] and distance > 0.0:
        normal = scaled(away, 1.0 / distance)
    write_piece_pair(to[1], (p, t), s, w, found.gap_m[i], normal)


@kernel
def write_capsule_violations(
    given: tuple[CandidateList, CapsuleMemory, ContactState, ContactPairs], start: FloatArray, tolerance_m: float
) -> int:
    """Append pairs of pieces with segments of the catheter that end too deep, and correct rows at such places.

    Pieces are those of tools, other strands of the catheter, and stones.
    Return the number of both. ``start`` (p, 2, 3) are the ends of the pieces at the start of the step. A pair keeps the
    side on which it began.
    """
    listed, memory, state, pairs = given
    tools, count = state.geometry.tools, 0
    for i in range(memory.active.shape[0]):
        for j in range(first_target(memory, i), memory.active.shape[1]):
            if memory.active[i, j] == 0 or not piece_can_touch(tools, i):
                continue
            side = row_of(memory.normal, i, j)
            s, t, distance, normal, apart_m = _measure_capsules(listed, memory, state, (i, j))
            if distance - apart_m >= -tolerance_m or is_of_neighbour(memory, (i, j), s, t):
                continue
            covering, corrected = _correct_capsule_rows(
                state, (i, j), (t, MARGIN * tolerance_m), normal, distance - apart_m
            )
            count += corrected
            if covering > 0:
                continue
            first, second = ends_of(start, i), ends_of(start, N_TOOL_PIECES + j)
            away = vector_between(first, second, s, t)
            if dot(away, normal) < apart_m and dot(away, side) > 0.0:  # round a corner, see `_write_violation`
                normal = unit(away)
            count += 1
            if pairs.count < min(MAX_NEW_ROWS, n_free_rows(state.rows)):
                tool, segment, particle = owner_of(i)
                pair = (tool, segment, particle, CATHETER_SEGMENT, j, s, (1.0 - t, t, 0.0))
                write_pair(pairs, pair, distance - apart_m, normal)
    return count


@inlined_kernel
def _measure_capsules(
    listed: CandidateList, memory: CapsuleMemory, state: ContactState, pair: tuple[int, int]
) -> tuple[float, float, float, Vector, float]:
    """Return those of `measure_pair` for (piece, segment of the catheter), and the distance (m) at which they touch."""
    (p, j), tools, rest_offset_m, free = pair, state.geometry.tools, 0.0, NO_END
    apart_m = listed.thickness[p] + listed.thickness[N_TOOL_PIECES + j] - 2.0 * state.geometry.wall.half_thickness
    if p < N_TOOL_PIECES:
        free = free_ends(p % 3, tools.radius[p // 3, JAW_A] > 0.0)
        if p % 3 != SHAFT and tools.held[p // 3, CATHETER_SEGMENT]:
            rest_offset_m = tools.rest_offset[p // 3, CATHETER_SEGMENT]
    first, second = ends_of(listed.ends, p), ends_of(listed.ends, N_TOOL_PIECES + j)
    s, t, distance, normal = measure_pair(first, second, row_of(memory.normal, p, j), (apart_m, free))
    return s, t, distance, normal, apart_m - rest_offset_m


@inlined_kernel
def _correct_capsule_rows(
    state: ContactState, pair: tuple[int, int], place: tuple[float, float], normal: Vector, end_m: float
) -> tuple[int, int]:
    """Return how many rows couple a piece with a segment here, and how many have been corrected.

    ``place`` is (place along the segment, depth in m beyond which nothing may deepen), ``end_m`` as for `_correct_row`.
    """
    (i, j), (t, most_m), covering, corrected = pair, place, 0, 0
    rows, motion = state.rows, state.problem.motion
    identity = pair_identity(*owner_of(i), CATHETER_SEGMENT, j)
    for at in range(rows.n_contacts):
        is_there = rows.identity[at] == identity and abs(rows.rod_weight[at, 3] + t) < SAME_POINT
        if is_there and dot(row_of(rows.frame, at, 0), normal) > SAME_NORMAL:
            covering += 1
            corrected += _correct_row(rows, motion, at, end_m, most_m)
    return covering, corrected


@kernel
def write_depths(
    given: tuple[CandidateList, Found, CapsuleMemory, ContactState], start: Where, out: FloatArray
) -> None:
    """Write how deep each piece (p,) is in the wall, and after them how deep each is in the catheter, in m.

    Candidates have been measured where the bodies are, in a step that began at ``start``. A depth has the side of the
    start, and no part that jaws have squeezed away.
    """
    listed, candidates, memory, state = given
    out[:] = 0.0
    _find_violations(listed, candidates, state, start, 0.0)
    found = candidates[1]
    for i in range(found.count):
        p = found.piece[i]
        out[p] = max(out[p], -found.gap_m[i])
    tools, first = state.geometry.tools, listed.ends.shape[0]
    for i in range(memory.active.shape[0]):
        for j in range(first_target(memory, i), memory.active.shape[1]):
            if memory.active[i, j] == 1 and piece_can_touch(tools, i):
                _, _, distance, _, apart_m = _measure_capsules(listed, memory, state, (i, j))
                out[first + i] = max(out[first + i], apart_m - distance)


@kernel
def write_chosen(found: Candidates, working: WorkingSet, span: tuple[int, int], pairs: ContactPairs) -> None:
    """Append the chosen candidates of a span of pieces (first, end) to pairs."""
    for k in range(working.n_chosen):
        i = working.chosen[k]
        p = found.piece[i]
        if span[0] <= p < span[1]:
            w, normal = row(found.weight, i), row(found.normal, i)
            write_piece_pair(pairs, (p, found.triangle[i]), found.s[i], w, found.gap_m[i], normal)
