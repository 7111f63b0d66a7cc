"""Contact rows of grasp holds, and their slip."""

from __future__ import annotations

import math
from typing import Annotated

from trocar.services.mechanics.arrays import BoolArray, ByteArray, FloatArray, IntArray, LongArray
from trocar.services.mechanics.bodies.forceps.tool_body import ToolArrays
from trocar.services.mechanics.collision.pairs import CATHETER_SEGMENT, SHAFT
from trocar.services.mechanics.compiled import inlined_kernel, kernel
from trocar.services.mechanics.compiled.struct import Address, Struct, reader
from trocar.services.mechanics.compiled.vectors import (
    Vector,
    along,
    combine,
    cross,
    dot,
    put_row,
    put_row_of,
    row_of,
    tangents,
    unit,
)
from trocar.services.mechanics.compiled.vectors import row as vector
from trocar.services.mechanics.contact.geometry import ContactGeometry
from trocar.services.mechanics.contact.identity import hold_identity
from trocar.services.mechanics.contact.laws import number_of
from trocar.services.mechanics.contact.rows import ContactRows, in_world
from trocar.services.mechanics.contact.state import ContactState, state_at
from trocar.services.mechanics.contact.writer import (
    NO_ROOM,
    add_tool_motion,
    append_row,
    put_on_curve,
    put_on_duct,
    put_on_tool,
)
from trocar.services.mechanics.rod.curve import point_on_curve

_GRIP = number_of("grip")
# Axis of a catheter's row that is tangential to the catheter; the first axis is across the jaws.
_ALONG = 1
# Distance from the jaws, in their radii, up to which a point is held.
JAW_WIDTH_RADII = 3.0
# Softness in the direction in which a held wall is free.
LOOSE_SOFTNESS_M_N = 1.0
# Smallest sine of the angle between catheter and opening direction at which the direction across the jaws is defined.
MIN_SINE_ACROSS = 0.1


class HoldArrays(Struct):
    """Holds in the order of their rows; the caller knows how many there are."""

    number: Annotated[LongArray, "h"]  # `GraspHold.hold_id`
    tool: Annotated[ByteArray, "h"]
    target_kind: Annotated[ByteArray, "h"]
    target: Annotated[IntArray, "h"]
    weights: Annotated[FloatArray, "h", 3]
    anchor: Annotated[FloatArray, "h", 3]  # along b, h and d of the tool from J, in m
    slipped_m: Annotated[FloatArray, "h"]
    lost: Annotated[BoolArray, "h"]

    def remove(self, slot: int) -> None:
        """Remove a hold; those behind it move up."""
        _, *arrays = self.own_memory()
        for array in arrays:
            array[slot:-1] = array[slot + 1 :]


holds_at = reader(HoldArrays)


@kernel
def append_holds(state_address: Address[ContactState], holds_address: Address[HoldArrays], count: int) -> int:
    """Append a bilateral row for each of the first ``count`` holds; return the number of rows."""
    state, holds = state_at(state_address), holds_at(holds_address)
    rows, geometry = state.rows, state.geometry
    n_rows = rows.reserved = 0
    for slot in range(count):
        row = append_row(rows, _GRIP, hold_identity(holds.number[slot]))
        if row == NO_ROOM:
            continue
        _tool_side(holds, slot, geometry.tools, rows, row)
        if holds.target_kind[slot] == CATHETER_SEGMENT:
            _catheter_side(holds, slot, geometry, rows, row)
        else:
            _wall_side(holds, slot, geometry, rows, row)
        n_rows += 1
    return n_rows


@kernel
def _tool_side(holds: HoldArrays, slot: int, tools: ToolArrays, rows: ContactRows, row: int) -> None:
    """Make a tool the first body."""
    tool, frame = holds.tool[slot], tools.frame[holds.tool[slot]]
    arm = combine(vector(holds.anchor, slot), vector(frame, 0), vector(frame, 1), vector(frame, 2))
    put_row(rows.point_m, row, arm)
    # The held point lies between both jaws, so that their opening does not move it, as if it were on the shaft.
    put_on_tool(rows, row, tools, tool, SHAFT)
    put_row(rows.slip_m, row, vector(rows.point_m, row))
    add_tool_motion(rows, row, tools)


@inlined_kernel
def _catheter_side(holds: HoldArrays, slot: int, geometry: ContactGeometry, rows: ContactRows, row: int) -> None:
    """Make the catheter the target: subtract the held point from the slip, and align the frame across the jaws."""
    rod = geometry.rod
    first, weights, slope = point_on_curve(rod.position, holds.target[slot] + holds.weights[slot, 1])
    put_on_curve(rows, row, first, weights)
    for k in range(3):
        for axis in range(3):
            rows.slip_m[row, axis] -= weights[k] * (rod.position[first + k, axis] + rod.motion[first + k, axis])
    tangent, opening = unit(slope), row_of(geometry.tools.frame, holds.tool[slot], 0)
    across = along(opening, tangent, -dot(opening, tangent))
    if dot(across, across) < MIN_SINE_ACROSS**2:  # the catheter lies along the opening direction: any normal will do
        across, _ = tangents(tangent[0], tangent[1], tangent[2])
    across = unit(across)
    put_row_of(rows.frame, row, 0, across)
    put_row_of(rows.frame, row, _ALONG, tangent)
    put_row_of(rows.frame, row, 2, cross(across, tangent))


@kernel
def _wall_side(holds: HoldArrays, slot: int, geometry: ContactGeometry, rows: ContactRows, row: int) -> None:
    """Make the wall the target, free along the opening direction, in which `squeeze` constrains it.

    The slip loses the wall's rest position here, and its motion in `subtract_duct_motion`.
    """
    wall, rows.softness_m_n[row, 0] = geometry.wall, LOOSE_SOFTNESS_M_N
    corners, weights = wall.triangles[holds.target[slot]], holds.weights[slot]
    put_on_duct(rows, row, corners, weights)
    for corner in range(3):
        for axis in range(3):
            rows.slip_m[row, axis] -= weights[corner] * wall.vertices[corners[corner], axis]
    for axis in range(3):
        put_row_of(rows.frame, row, axis, row_of(geometry.tools.frame, holds.tool[slot], axis))


@kernel
def slide_holds(
    state_address: Address[ContactState], holds_address: Address[HoldArrays], span: tuple[int, int], share: float
) -> tuple[float, bool]:
    """Slide the holds at their force limit by the share of the solved slip that has happened.

    ``span`` is (first row, number of rows). A solve that was cut short leaves a slip to holds below their limit too: if
    their springs stored it, they would give out energy that nobody has put in.

    Return the energy in J that this dissipated, and whether a hold was lost.
    """
    state, holds = state_at(state_address), holds_at(holds_address)
    rows = state.rows
    dissipated_j, is_lost = 0.0, False
    first, count = span
    for slot in range(count):
        row = first + slot
        state.slides[row] |= state.problem.is_cut
        if not state.slides[row]:
            continue
        motion, at = state.problem.motion, 3 * row
        u = share * motion[at], share * motion[at + 1], share * motion[at + 2]
        dissipated_j -= dot(vector(rows.force_n, row), u)
        slip = in_world(rows, row, u)
        holds.slipped_m[slot] += math.sqrt(dot(slip, slip))
        if holds.target_kind[slot] == CATHETER_SEGMENT:
            slip = _slide_along_catheter(holds, slot, slip, state.geometry.rod.position)
        _slide_in_jaws(holds, slot, slip, state.geometry.tools)
        is_lost = is_lost or holds.lost[slot]
    return dissipated_j, is_lost


@kernel
def _slide_along_catheter(holds: HoldArrays, slot: int, slip: Vector, position: FloatArray) -> Vector:
    """Move the held point along the catheter by the axial part of ``slip``, and return the rest.

    Beyond an end of the catheter the hold is lost.
    """
    place, n_segments = holds.target[slot] + holds.weights[slot, 1], position.shape[0] - 1
    _, _, slope = point_on_curve(position, place)
    tangent = unit(slope)
    axial = dot(slip, tangent)
    place += axial / dot(slope, tangent)
    holds.lost[slot] |= not 0.0 <= place <= n_segments
    place = min(max(place, 0.0), float(n_segments))
    holds.target[slot] = min(int(place), n_segments - 1)
    s = place - holds.target[slot]
    holds.weights[slot, 0], holds.weights[slot, 1], holds.weights[slot, 2] = 1.0 - s, s, 0.0
    return along(slip, tangent, -axial)


@kernel
def _slide_in_jaws(holds: HoldArrays, slot: int, slip: Vector, tools: ToolArrays) -> None:
    """Move the held point in the jaws by minus ``slip``; if it leaves the jaws, the hold is lost."""
    tool, anchor = holds.tool[slot], holds.anchor[slot]
    for axis in range(3):
        anchor[axis] -= dot(row_of(tools.frame, tool, axis), slip)
    width = JAW_WIDTH_RADII * tools.jaw_radius[tool]
    is_along = -width <= anchor[2] <= tools.jaw_length[tool] + width
    holds.lost[slot] |= not (is_along and abs(anchor[0]) <= width and abs(anchor[1]) <= width)
