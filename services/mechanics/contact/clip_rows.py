"""Contact rows of a clip: its two legs press the wall of the duct on the catheter from opposite sides.

A leg is a plate, as it is wider than the duct. Its *pull* draws the wall to the catheter with the force of the clip,
whatever moves; the other leg draws as much the other way, so that the catheter bears none of it. Its *pad* is the
contact of wall and catheter under the plate, with the friction of every other. So each side of the catheter is pressed
by the force of the clip less what the wall resists, and slips at its friction.

The plates stay parallel and turn with their section of the duct, not with the line between the two points of the wall:
these move sideways under a plate, which does no work. So the pulls have a potential, their force times the distance of
the points across the plates, and a clip gives out no more energy than it was closed with. Where sections turn, a point
beside the catheter comes nearer to a plate, or farther from it, by the plate's turn alone. That is part of the rows
(`turn_plates`): what a leg bears beside the catheter has a moment, and the section bears it that turns the plate.
"""

from __future__ import annotations

import math
from typing import Annotated

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.bodies.duct_loads import DuctLoads, loads_at
from trocar.services.mechanics.collision.pairs import DUCT_TRIANGLE, NO_TOOL
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Address, Struct, reader
from trocar.services.mechanics.compiled.vectors import (
    along,
    between,
    cross,
    dot,
    put_row,
    row_of,
    scaled,
    squared_distance,
    subtract,
    write_frame,
)
from trocar.services.mechanics.compiled.vectors import row as vector
from trocar.services.mechanics.contact.identity import TARGET_KIND, hold_identity, part_of
from trocar.services.mechanics.contact.laws import number_of
from trocar.services.mechanics.contact.rows import NO_STONE
from trocar.services.mechanics.contact.state import ContactState, state_at
from trocar.services.mechanics.contact.writer import FIRST_SIDE, NO_ROOM, append_row, put_on_duct, put_on_rod
from trocar.services.mechanics.reduction.large_rotations.warping_kernels import WarpedTube, tube_at, turn_rates

_PULL, _PAD = number_of("pull"), number_of("unilateral")
N_LEGS = 2
_FIRST_NUMBER = (1 << 30) + 1
"""Identities are those of holds, beyond the numbers of any; odd ones have the wall as their target."""
_FAR_M = 1.0
"""A pull is never at its end: from so far away it draws with all its force."""
_NOT_THERE = -1


class Clip(Struct):
    """A clip: its place on the duct, how far it has closed, and what it does."""

    triangle: Annotated[IntArray, N_LEGS]  # of the wall, under each leg
    weights: Annotated[FloatArray, N_LEGS, 3]
    rest_m: Annotated[FloatArray, N_LEGS, 3]  # where that is on the duct at rest
    place_m: Annotated[FloatArray, N_LEGS, 3]  # where it is
    towards: Annotated[FloatArray, N_LEGS, 3]  # unit vectors across the plates, to the other leg
    inward: Annotated[FloatArray, 3]  # along the duct
    row: Annotated[IntArray, N_LEGS]  # of each pad in this step, or `_NOT_THERE`
    pull: Annotated[IntArray, N_LEGS]  # of each pull, likewise
    reach_m: float  # from its middle, within which what touches the duct is under it
    closing_n: float  # force of its spring once it is closed
    rate_n_s: float  # at which that force grows
    is_closed: bool = False
    segment: int = _NOT_THERE  # of the catheter, where it passes the clip
    share: float = 0.0  # of that segment
    pull_n: float = 0.0  # of each leg now
    pressing_n: float = 0.0  # with which each side of the catheter is pressed
    squeezed_n: float = 0.0  # with which jaws squeeze the duct there
    given_j: float = 0.0  # work of whoever closes it
    lost_j: float = 0.0  # by its spring, as it opened when the catheter had left it


clip_at = reader(Clip)


@kernel
def find_catheter(state_address: Address[ContactState], clip_address: Address[Clip]) -> bool:
    """Note where the catheter passes the clip at the start of the step; return whether it does."""
    state, clip = state_at(state_address), clip_at(clip_address)
    clip.segment, clip.share = _passage(clip, state.geometry.rod.position)
    return bool(clip.segment != _NOT_THERE)


@kernel
def append_clip(state_address: Address[ContactState], clip_address: Address[Clip]) -> None:
    """Append pull and pad of both legs of a closed clip where the catheter passes it; else it lies open."""
    state, clip = state_at(state_address), clip_at(clip_address)
    clip.row[:] = clip.pull[:] = _NOT_THERE
    if not clip.is_closed or clip.segment == _NOT_THERE:
        return
    for leg in range(N_LEGS):
        clip.row[leg] = _append_leg(state, clip, (leg, False))
        clip.pull[leg] = spring = _append_leg(state, clip, (leg, True))
        if spring != NO_ROOM:
            state.rows.force_limit_n[spring] = clip.pull_n
            put_row(
                state.rows.slip_m,
                spring,
                along(vector(state.rows.slip_m, spring), vector(clip.towards, leg), _FAR_M),
            )


@kernel
def _passage(clip: Clip, position: FloatArray) -> tuple[int, float]:
    """Return where the catheter crosses the clip's plane within the duct: a segment and the share of it."""
    middle = between(vector(clip.place_m, 0), vector(clip.place_m, 1), 0.5)
    inward = (clip.inward[0], clip.inward[1], clip.inward[2])
    found, share, nearest_2 = _NOT_THERE, 0.0, clip.reach_m * clip.reach_m
    for segment in range(position.shape[0] - 1):
        start = dot(inward, subtract(vector(position, segment), middle))
        end = dot(inward, subtract(vector(position, segment + 1), middle))
        if (start >= 0.0) == (end >= 0.0):
            continue
        s = start / (start - end)
        away_2 = squared_distance(middle, between(vector(position, segment), vector(position, segment + 1), s))
        if away_2 < nearest_2:
            found, share, nearest_2 = segment, s, away_2
    return found, share


@kernel
def _append_leg(state: ContactState, clip: Clip, which: tuple[int, bool]) -> int:
    """Append a row between the catheter and the wall under a leg, and return its index or `NO_ROOM`.

    ``which`` is (leg, whether it is its pull, not its pad).
    """
    rows, rod, wall = state.rows, state.geometry.rod, state.geometry.wall
    (leg, is_pull), segment, s = which, clip.segment, clip.share
    number = _FIRST_NUMBER + 2 * (leg + (N_LEGS if is_pull else 0))
    row = append_row(rows, _PULL if is_pull else _PAD, hold_identity(number))
    if row == NO_ROOM:
        return row
    put_row(rows.frame[row], 0, vector(clip.towards, leg))
    write_frame(rows.frame[row, 0], rows.frame[row])
    put_on_rod(rows, row, FIRST_SIDE, (segment, segment + 1), (1.0 - s, s))
    put_on_duct(rows, row, wall.triangles[clip.triangle[leg]], clip.weights[leg])
    centre = between(vector(rod.position, segment), vector(rod.position, segment + 1), s)
    normal = vector(clip.towards, leg)
    put_row(rows.point_m, row, along(centre, normal, -rod.radius[segment]))
    put_row(rows.slip_m, row, between(vector(rod.motion, segment), vector(rod.motion, segment + 1), s))
    if not is_pull:
        clearance = subtract(vector(rows.point_m, row), vector(clip.rest_m, leg))
        rows.gap_m[row] = dot(normal, clearance) - wall.half_thickness
    return row


@kernel
def turn_plates(
    state_address: Address[ContactState],
    clip_address: Address[Clip],
    wall_addresses: tuple[Address[WarpedTube], Address[DuctLoads]],
    motion_m: FloatArray,
) -> None:
    """Add to the rows, and to ``motion_m`` (k, 3), how the distances across the plates change as these turn.

    With p a leg's point of the wall, c the catheter's and n across the plate the distance is n . (c - p): a section
    that turns by w changes it by (w x n) . (c - p) beyond the motion of both points. The rows are those of the step's
    start, as its normals. ``motion_m`` receives the free motion.
    """
    state, clip, tube, duct = (
        state_at(state_address),
        clip_at(clip_address),
        tube_at(wall_addresses[0]),
        loads_at(wall_addresses[1]),
    )
    rows, node = state.rows, state.geometry.wall.triangles[clip.triangle[0], 0]
    for row in range(rows.n_contacts):
        put_row(motion_m, row, (0.0, 0.0, 0.0))
    for leg in range(N_LEGS):
        if clip.row[leg] < 0 or clip.pull[leg] < 0:
            continue
        normal, pad = vector(clip.towards, leg), clip.row[leg]
        place = along(vector(clip.rest_m, leg), vector(duct.displacement, pad), 1.0)
        rates = turn_rates(tube, node, cross(normal, subtract(place, vector(rows.point_m, pad))))
        turned_m = 0.0
        for mode in range(rates.shape[0]):
            turned_m += rates[mode] * duct.free.change[mode]
        for row in (pad, clip.pull[leg]):
            put_row(motion_m, row, scaled(normal, turned_m))
            for axis in range(3):
                for mode in range(rates.shape[0]):
                    duct.modes[3 * row + axis, mode] += normal[axis] * rates[mode]


@kernel
def follow_clip(state_address: Address[ContactState], clip_address: Address[Clip], displacement_m: FloatArray) -> None:
    """Note what presses at the end of the step, and where the wall is.

    ``displacement_m`` (k, 3) is that of the contacts' points of the wall, at the start of the step.
    """
    state, clip = state_at(state_address), clip_at(clip_address)
    clip.pressing_n, clip.squeezed_n = _common_n(state, clip, False), _common_n(state, clip, True)
    for leg in range(N_LEGS):
        if clip.row[leg] >= 0:
            put_row(clip.place_m, leg, along(vector(clip.rest_m, leg), vector(displacement_m, clip.row[leg]), 1.0))


@kernel
def _common_n(state: ContactState, clip: Clip, of_tools: bool) -> float:
    """Return the normal force (N) that both sides under the clip have in common: of the catheter's wall, or of jaws.

    A score takes it from frames by the same rule: `trocar.services.training.situation.Loads.sides`.
    """
    rows, total, net = state.rows, 0.0, (0.0, 0.0, 0.0)
    middle = between(vector(clip.place_m, 0), vector(clip.place_m, 1), 0.5)
    for row in range(rows.n_contacts):
        is_tool, normal_n = rows.tool[row] != NO_TOOL, max(rows.force_n[row, 0], 0.0)
        on_wall = rows.duct_weight[row, 0] != 0.0 or rows.duct_weight[row, 1] != 0.0 or rows.duct_weight[row, 2] != 0.0
        if is_tool and not on_wall:  # a squeezed wall's row moves no node
            on_wall = rows.identity[row] > 0 and part_of(rows.identity[row], TARGET_KIND) == DUCT_TRIANGLE
        if is_tool != of_tools or not on_wall or rows.stone[row] != NO_STONE:
            continue
        if squared_distance(vector(rows.point_m, row), middle) < clip.reach_m * clip.reach_m:
            total += normal_n
            net = along(net, row_of(rows.frame, row, 0), normal_n)
    return 0.5 * (total - math.sqrt(dot(net, net)))
