"""How deep pieces may be in the wall: the surface of jaws between which it is squeezed.

Jaws have come nearer to the middle of a layer by what they have squeezed away of it. That is less beside the line in
which they are nearest, and further out along them, where they are wider open. So what the middle surface touches is no
round bar: it is flatter, and its normal lies nearer to the way in which the jaws open. A row's force acts along it, as
the gradient of what it holds at zero. Along the piece's own normal it would do work on a wall that slides over the
jaws, and no row would know that such a wall also comes deeper: in a jammed catheter prices then add five in each tick.
"""

from __future__ import annotations

import math

from services.mechanics.bodies.forceps.kinematics import N_CELLS, N_SEGMENTS
from services.mechanics.collision.pairs import DUCT_TRIANGLE, JAW_A, SHAFT
from services.mechanics.collision.pieces import N_TOOL_PIECES
from services.mechanics.compiled import kernel
from services.mechanics.compiled.vectors import Vector, along, dot, row, row_of, scaled, subtract
from services.mechanics.contact.geometry import ToolGeometry

Surface = tuple[float, float, float, Vector]
"""Room along the piece's normal; along that of the surface, with its change per radian of opening; this normal."""


@kernel
def can_touch(tools: ToolGeometry, tool: int) -> bool:
    """Whether a tool touches anything: it is there, and does not wait."""
    return bool(tools.present[tool] and not tools.disengaged[tool])


@kernel
def piece_can_touch(tools: ToolGeometry, p: int) -> bool:
    """Return whether a piece touches anything: pieces of tools that are gone, or wait, do not."""
    return bool(p >= N_TOOL_PIECES or can_touch(tools, p // N_SEGMENTS))


@kernel
def overlap_in_jaws(tools: ToolGeometry, p: int, s: float, normal: Vector) -> float:
    """Return how deep the wall may be in a piece: what jaws squeezed away, or what lay in them when they took it."""
    room: float = jaw_surface(tools, p, s, normal)[0]
    return room


@kernel
def jaw_surface(tools: ToolGeometry, p: int, s: float, normal: Vector) -> Surface:
    """Return the surface that a piece has for the wall's middle surface, at a place along it and along its normal.

    Jaws are round: along a normal at an angle a to the way in which they open, the plane midway between them is
    (r + h / 2) / cos(a) - r away from a jaw of radius r, h being their distance, and the middle of a layer half as far.
    For a = 0 half a layer is thinner by t / 2 - h / 4. Where the normal does not lead out of the jaws, nothing is.
    """
    if p >= N_TOOL_PIECES or p % N_SEGMENTS == SHAFT:
        return 0.0, 0.0, 0.0, normal
    tool, jaw = p // N_SEGMENTS, p % N_SEGMENTS
    held: float = tools.rest_offset[tool, DUCT_TRIANGLE] if tools.held[tool, DUCT_TRIANGLE] else 0.0
    opens = scaled(row(tools.frame[tool], 0), 1.0 if jaw == JAW_A else -1.0)
    facing, radius = dot(normal, opens), tools.radius[tool, jaw]
    if facing <= 0.0:
        return held, held, 0.0, normal
    cell = min(max(s * N_CELLS - 0.5, 0.0), N_CELLS - 1.0)
    first = min(int(cell), N_CELLS - 2)
    share, depth, slopes = cell - first, tools.indentation[tool], tools.indentation_slope[tool]
    thinner, half = (1.0 - share) * depth[first] + share * depth[first + 1], 0.5 * (tools.wall_thickness + radius)
    room = (thinner - half * (1.0 - facing)) / facing
    if room <= held:
        return held, held, 0.0, normal
    reach = radius + 0.5 * tools.wall_thickness
    gradient = along(normal, subtract(opens, scaled(normal, facing)), (half - thinner) / (facing**2 * (reach - room)))
    if 0.0 < s < 1.0:  # along itself a jaw has one normal
        start, end = row_of(tools.segments[tool], jaw, 0), row_of(tools.segments[tool], jaw, 1)
        axis = subtract(end, start)
        rises = N_CELLS * (depth[first + 1] - depth[first]) / facing if 0.0 < cell < N_CELLS - 1.0 else 0.0
        gradient = along(gradient, axis, -(dot(gradient, axis) + rises) / dot(axis, axis))
    size = math.sqrt(dot(gradient, gradient))
    slope = ((1.0 - share) * slopes[first] + share * slopes[first + 1]) / facing
    return room, reach - (reach - room) / size, slope / size, scaled(gradient, 1.0 / size)
