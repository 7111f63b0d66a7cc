"""Contact rows from detected pairs, with the bodies' positions at the start of the step."""

from __future__ import annotations

from trocar.services.mechanics.bodies.forceps.tool_body import ToolArrays
from trocar.services.mechanics.collision.pairs import (
    CATHETER_SEGMENT,
    DUCT_TRIANGLE,
    JAW_A,
    NO_TOOL,
    SHAFT,
    ContactPairs,
    pairs_at,
)
from trocar.services.mechanics.compiled import inlined_kernel, kernel
from trocar.services.mechanics.compiled.struct import Address
from trocar.services.mechanics.compiled.vectors import (
    Vector,
    along,
    between,
    dot,
    put_row,
    row_of,
    subtract,
    write_frame,
)
from trocar.services.mechanics.compiled.vectors import row as row_at
from trocar.services.mechanics.contact.clearance import can_touch, jaw_surface
from trocar.services.mechanics.contact.geometry import ContactGeometry, RodGeometry, WallGeometry, geometry_at
from trocar.services.mechanics.contact.identity import pair_identity
from trocar.services.mechanics.contact.laws import number_of
from trocar.services.mechanics.contact.rows import ContactRows, rows_at
from trocar.services.mechanics.contact.writer import (
    FIRST_SIDE,
    NO_ROOM,
    TARGET_SIDE,
    add_tool_motion,
    append_row,
    put_on_duct,
    put_on_rod,
    put_on_tool,
)

_UNILATERAL = number_of("unilateral")


@kernel
def append_pairs(
    pairs_address: Address[ContactPairs], geometry_address: Address[ContactGeometry], rows_address: Address[ContactRows]
) -> int:
    """Append pairs as unilateral contacts, except those of absent or disengaged tools; return how many were dropped.

    The duct's displacement is not yet part of gap and slip, because it needs the modes: see `subtract_duct_motion`.
    Jaws also collide with the body that they hold, because a hold ties only two points.
    """
    pairs, geometry, rows = pairs_at(pairs_address), geometry_at(geometry_address), rows_at(rows_address)
    for index in range(pairs.count):
        tool, segment = pairs.tool[index], pairs.tool_segment[index]
        kind, target = pairs.target_kind[index], pairs.target[index]
        if tool != NO_TOOL and not can_touch(geometry.tools, tool):
            continue
        identity = pair_identity(tool, segment, pairs.particle[index], kind, target)
        row = append_row(rows, _UNILATERAL, identity)
        if row == NO_ROOM:
            continue
        write_frame(pairs.normal[index], rows.frame[row])
        if tool != NO_TOOL:
            _tool_side(pairs, index, geometry.tools, rows, row)
        elif pairs.particle[index] >= geometry.rod.position.shape[0] - 1:
            _sphere_side(pairs, index, geometry, rows, row)
        else:
            _catheter_side(pairs, index, geometry.rod, rows, row)
        if kind == CATHETER_SEGMENT:
            _catheter_target(pairs, index, geometry.rod, rows, row)
        elif kind == DUCT_TRIANGLE:
            _wall_target(pairs, index, geometry.wall, rows, row)
    return pairs.dropped


@kernel
def _tool_side(pairs: ContactPairs, index: int, tools: ToolArrays, rows: ContactRows, row: int) -> None:
    """Make a tool the first body. With a squeezed wall the force acts at the wall's middle surface."""
    tool, segment, s = pairs.tool[index], pairs.tool_segment[index], pairs.tool_parameter[index]
    radial, radius, kind = row_at(pairs.normal, index), tools.radius[tool, segment], pairs.target_kind[index]
    normal, reach, opening_rate = radial, radius, 0.0
    if kind == DUCT_TRIANGLE:
        overlap, rows.rest_offset_m[row], opening_rate, normal = jaw_surface(tools, 3 * tool + segment, s, radial)
        if rows.rest_offset_m[row] != overlap:  # the wall is squeezed: its surface's normal replaces that of the jaw
            reach = radius + 0.5 * tools.wall_thickness - overlap
            put_row(rows.frame[row], 0, normal)
            write_frame(rows.frame[row, 0], rows.frame[row])
    ends, junction = tools.segments[tool], row_of(tools.segments[tool], JAW_A, 0)
    centre = between(row_of(ends, segment, 0), row_of(ends, segment, 1), s)
    rows.gap_m[row] = dot(normal, along(centre, normal, -radius))
    put_row(rows.point_m, row, subtract(along(centre, radial, -reach), junction))
    put_on_tool(rows, row, tools, tool, segment)
    for axis in range(3):  # as the jaws open, the wall thickens, and its middle surface moves half as far as they do
        rows.lever[row, axis, 3] += opening_rate * rows.frame[row, 0, axis]
    if kind == CATHETER_SEGMENT and segment != SHAFT and tools.held[tool, kind]:
        rows.rest_offset_m[row] = tools.rest_offset[tool, kind]
        rows.force_limit_n[row] = 0.0  # the hold bears the force along the jaws
    add_tool_motion(rows, row, tools)


@inlined_kernel
def _catheter_side(pairs: ContactPairs, index: int, rod: RodGeometry, rows: ContactRows, row: int) -> None:
    """Make the catheter the first body."""
    first, s = pairs.particle[index], pairs.tool_parameter[index]
    second = min(first + 1, rod.position.shape[0] - 1)
    put_on_rod(rows, row, FIRST_SIDE, (first, second), (1.0 - s, s))
    centre = between(row_at(rod.position, first), row_at(rod.position, second), s)
    motion = between(row_at(rod.motion, first), row_at(rod.motion, second), s)
    _put_surface(rows, row, (row_at(pairs.normal, index), centre, motion), rod.radius[first])


@inlined_kernel
def _sphere_side(pairs: ContactPairs, index: int, geometry: ContactGeometry, rows: ContactRows, row: int) -> None:
    """Make a sphere the first body; in pairs, spheres are numbered after the segments of the catheter."""
    spheres, sphere = geometry.spheres, pairs.particle[index] - (geometry.rod.position.shape[0] - 1)
    rows.stone[row] = sphere
    place = row_at(pairs.normal, index), row_at(spheres.start, sphere), row_at(spheres.motion, sphere)
    _put_surface(rows, row, place, spheres.radius[sphere])


@kernel
def _put_surface(rows: ContactRows, row: int, place: tuple[Vector, Vector, Vector], radius: float) -> None:
    """Write point, slip and the first body's part of the gap; ``place`` is (normal, point on the axis, its motion)."""
    normal, centre, motion = place
    point = along(centre, normal, -radius)
    rows.gap_m[row] = dot(normal, point)
    put_row(rows.point_m, row, point)
    put_row(rows.slip_m, row, motion)


@inlined_kernel
def _catheter_target(pairs: ContactPairs, index: int, rod: RodGeometry, rows: ContactRows, row: int) -> None:
    """Make a segment of the catheter the target."""
    target, weights = pairs.target[index], pairs.target_weights[index]
    put_on_rod(rows, row, TARGET_SIDE, (target, target + 1), (-weights[0], -weights[1]))
    rows.gap_m[row] -= rod.radius[target]
    for end in range(2):
        for axis in range(3):
            rows.gap_m[row] -= pairs.normal[index, axis] * weights[end] * rod.position[target + end, axis]
            rows.slip_m[row, axis] -= weights[end] * rod.motion[target + end, axis]


@inlined_kernel
def _wall_target(pairs: ContactPairs, index: int, wall: WallGeometry, rows: ContactRows, row: int) -> None:
    """Make a triangle of the wall the target."""
    corners, weights = wall.triangles[pairs.target[index]], pairs.target_weights[index]
    put_on_duct(rows, row, corners, weights)
    rows.gap_m[row] -= wall.half_thickness
    for corner in range(3):
        for axis in range(3):
            rows.gap_m[row] -= rows.frame[row, 0, axis] * weights[corner] * wall.vertices[corners[corner], axis]
