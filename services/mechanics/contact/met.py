"""Pairs that only the solved motion of a step brings into each other: which of them need a row, and along which normal.

Detection finds them where the step will end, so that all rows must know is the step's start.
"""

from __future__ import annotations

import math

from services.mechanics.arrays import FloatArray, IntArray
from services.mechanics.collision.beside import place_along
from services.mechanics.collision.folds import SAME_FLANK
from services.mechanics.collision.pairs import CATHETER_SEGMENT, NO_TOOL, ContactPairs, pairs_at
from services.mechanics.collision.writer import copy_pair
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address
from services.mechanics.compiled.vectors import (
    Vector,
    along,
    combine,
    dot,
    put_row,
    row,
    scaled,
    squared_distance,
    subtract,
)
from services.mechanics.contact.geometry import ContactGeometry
from services.mechanics.contact.identity import target_kind_of, tool_segment_of
from services.mechanics.contact.laws import HAS_GAP
from services.mechanics.contact.manifold import ONE_POINT
from services.mechanics.contact.pair_rows import touches
from services.mechanics.contact.rows import NO_STONE, ContactRows, rows_at
from services.mechanics.contact.state import ContactState, state_at

# Detection moves the wall under its loads on the nodes round them only: it may be so far off, where a row is not.
NEARLY_MET_M = 50e-6
# What is pressed, or is being pushed out, comes no nearer than this, nor than this part of a thin wall.
LEAST_APPROACH_M, LEAST_OF_WALL = 5e-6, 1.0 / 16.0
# Unless there is no row for it: none so near along a tool, as a part of the distance between axis and mid-surface.
KNOWN_BESIDE = 0.25


@kernel
def list_corners(pairs_address: Address[ContactPairs], triangles: IntArray, out: IntArray) -> int:
    """Write the corners of the triangles that pairs name into ``out`` (3 n,), 0 for other targets; return 3 n."""
    pairs = pairs_at(pairs_address)
    for i in range(pairs.count):
        for corner in range(3):
            on_wall = pairs.target_kind[i] != CATHETER_SEGMENT
            out[3 * i + corner] = triangles[pairs.target[i], corner] if on_wall else 0
    return 3 * int(pairs.count)


@kernel
def keep_approaching(
    pairs_address: Address[ContactPairs], state_address: Address[ContactState], corners: FloatArray
) -> None:
    """Keep of the pairs found where a step ends those that meet there and that no row foresees; write by how much.

    ``corners`` (3 n, 3) are those of `list_corners` at the start of the step. Afterwards ``gap_m`` is how much less the
    gap is at the end than at the start along the pair's normal. That is the one at the end, but where the pair would
    seem to overlap along it at the start already, as it does round a corner, or where the solved step takes the wall
    through a tool: there it is the one at the start, the side on which they are.
    """
    pairs, state, kept = pairs_at(pairs_address), state_at(state_address), 0
    geometry = state.geometry
    least = least_approach_m(geometry.wall.half_thickness)
    for i in range(pairs.count):
        tool = pairs.tool[i]
        if not pairs.gap_m[i] < NEARLY_MET_M:
            continue
        if tool != NO_TOOL and not touches(geometry.tools, tool, pairs.tool_segment[i], pairs.target_kind[i]):
            continue
        away, thickness = _start_offset(pairs, i, geometry, corners)
        normal, distance = row(pairs.normal, i), math.sqrt(dot(away, away))
        start, nearest = dot(away, normal) - thickness, distance - thickness
        if _has_row(state, pairs, i):
            continue
        if start - pairs.gap_m[i] < least and _is_foreseen(state, pairs, i):
            continue
        copy_pair(pairs, i, kept)
        if start < 0.0 and distance > 0.0:
            put_row(pairs.normal, kept, scaled(away, 1.0 / distance))
            start = nearest
        pairs.gap_m[kept] = start - pairs.gap_m[i]
        kept += 1
    pairs.count = kept


@kernel
def least_approach_m(half_thickness_m: float) -> float:
    """Return by how much a pair comes nearer, or is deeper than a row, at least, to count."""
    return min(LEAST_APPROACH_M, 2.0 * LEAST_OF_WALL * half_thickness_m)


@kernel
def _has_row(state: ContactState, pairs: ContactPairs, i: int) -> bool:
    """Return whether a row keeps the same piece of a tool off the same point of the wall: another would do no more."""
    rows, tool, segment = state.rows, pairs.tool[i], pairs.tool_segment[i]
    if tool == NO_TOOL or pairs.target_kind[i] == CATHETER_SEGMENT:
        return False
    wall = state.geometry.wall
    near, corners = ONE_POINT * (state.geometry.tools.radius[tool, segment] + wall.half_thickness), wall.triangles
    mine = _at_rest(wall.vertices, corners[pairs.target[i]], pairs.target_weights[i])
    for at in range(rows.n_contacts):
        if _faces_alike(rows, at, pairs, i) and tool_segment_of(rows.identity[at]) == segment:
            known = _at_rest(wall.vertices, rows.duct_node[at], rows.duct_weight[at])
            if squared_distance(mine, known) < near * near:
                return True
    return False


@kernel
def _at_rest(vertices: FloatArray, nodes: IntArray, weights: FloatArray) -> Vector:
    """Return where a point of the wall, between three nodes, is at rest."""
    w = weights[0], weights[1], weights[2]
    return combine(w, row(vertices, nodes[0]), row(vertices, nodes[1]), row(vertices, nodes[2]))


@kernel
def _is_foreseen(state: ContactState, pairs: ContactPairs, i: int) -> bool:
    """Return whether a row of the same bodies that faces the same way, near by, leads as deep as a pair found."""
    rows, motion, least = state.rows, state.problem.motion, least_approach_m(state.geometry.wall.half_thickness)
    for at in range(rows.n_contacts):
        if not (_faces_alike(rows, at, pairs, i) and _is_near(state, at, pairs, i)):
            continue
        if rows.gap_m[at] - rows.taken_m[at] + motion[3 * at] < pairs.gap_m[i] + least:
            return True
    return False


@kernel
def _faces_alike(rows: ContactRows, at: int, pairs: ContactPairs, i: int) -> bool:
    """Return whether a row keeps the bodies of a pair apart, and in its direction."""
    if rows.tool[at] != pairs.tool[i] or not HAS_GAP[rows.law[at]] or rows.stone[at] != NO_STONE:
        return False
    if target_kind_of(rows.identity[at]) != pairs.target_kind[i]:
        return False
    return bool(dot(row(rows.frame[at], 0), row(pairs.normal, i)) >= SAME_FLANK)


@kernel
def _is_near(state: ContactState, at: int, pairs: ContactPairs, i: int) -> bool:
    """Return whether a row acts on the particle of a pair, or on the segment of its tool and not far along it."""
    rows, tools, tool, segment = state.rows, state.geometry.tools, pairs.tool[i], pairs.tool_segment[i]
    if tool == NO_TOOL:
        return bool(rows.rod_node[at, 0] == pairs.particle[i])
    if tool_segment_of(rows.identity[at]) != segment:
        return False
    ends, s = tools.segments[tool, segment], pairs.tool_parameter[i]
    axis = row(ends, 0), row(ends, 1)
    on_axis = along(scaled(axis[0], 1.0 - s), axis[1], s)
    t = place_along(row(rows.point_m, at), axis)
    known = along(scaled(axis[0], 1.0 - t), axis[1], t)
    near = KNOWN_BESIDE * (tools.radius[tool, segment] + state.geometry.wall.half_thickness)
    return bool(squared_distance(known, on_axis) <= near * near)


@kernel
def _start_offset(pairs: ContactPairs, i: int, geometry: ContactGeometry, corners: FloatArray) -> tuple[Vector, float]:
    """Return the vector from the target's point to the first body's axis at the start, and both bodies' thickness."""
    s, w, rod, tool = pairs.tool_parameter[i], row(pairs.target_weights, i), geometry.rod, pairs.tool[i]
    if tool != NO_TOOL:
        ends, radius = (
            geometry.tools.segments[tool, pairs.tool_segment[i]],
            geometry.tools.radius[tool, pairs.tool_segment[i]],
        )
        here = along(scaled(row(ends, 0), 1.0 - s), row(ends, 1), s)
    else:
        first, radius = pairs.particle[i], rod.radius
        second = min(first + 1, rod.position.shape[0] - 1)
        here = along(scaled(row(rod.position, first), 1.0 - s), row(rod.position, second), s)
    if pairs.target_kind[i] == CATHETER_SEGMENT:
        target = pairs.target[i]
        there = along(scaled(row(rod.position, target), w[0]), row(rod.position, target + 1), w[1])
        return subtract(here, there), radius + rod.radius
    there = combine(w, row(corners, 3 * i), row(corners, 3 * i + 1), row(corners, 3 * i + 2))
    return subtract(here, there), radius + geometry.wall.half_thickness


@kernel
def drop_shallow(
    rows_address: Address[ContactRows], pairs_address: Address[ContactPairs], first: int, tolerance_m: float
) -> bool:
    """Keep those pairs whose rows, from ``first`` on, end deeper than a tolerance; return whether any was dropped.

    Rows know what the wall does under all its loads, and how deep it may be in jaws that hold or squeeze it.
    """
    rows, pairs, kept = rows_at(rows_address), pairs_at(pairs_address), 0
    count = min(pairs.count, rows.n_contacts - first)
    for i in range(count):
        if rows.gap_m[first + i] + rows.pad_m[first + i] - pairs.gap_m[i] < -tolerance_m:
            copy_pair(pairs, i, kept)
            pairs.gap_m[kept] = pairs.gap_m[i]
            kept += 1
    is_less = kept < count
    pairs.count = kept
    return is_less
