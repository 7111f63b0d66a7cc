"""The surface of jaws that squeeze the wall, and the overlap of jaws and undeformed wall that it allows.

A jaw that squeezes a layer of the wall comes nearer to the layer's middle surface by the indentation. The indentation
decreases with the distance from the line in which the jaws are nearest to each other, and towards the tips, where they
are wider open. So the surface that the middle surface touches is flatter than a round bar, and its normal is nearer to
the direction in which the jaws open. The force of a row acts along the gradient of the clearance that the row holds at
zero. Along the normal of the round bar it would do work on a wall that slides over the jaws, and the row would neglect
the indentation's change with the position.
"""

from __future__ import annotations

import math

from trocar.services.mechanics.bodies.forceps.kinematics import N_CELLS, N_SEGMENTS
from trocar.services.mechanics.bodies.forceps.tool_body import ToolArrays
from trocar.services.mechanics.collision.pairs import DUCT_TRIANGLE, JAW_A, SHAFT
from trocar.services.mechanics.collision.pieces import N_TOOL_PIECES
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.vectors import Vector, along, dot, row, row_of, scaled, subtract

Surface = tuple[float, float, float, Vector]
"""Allowed overlap (m) along the piece's normal; that along the surface's normal; its slope (m/rad); this normal."""


@kernel
def can_touch(tools: ToolArrays, tool: int) -> bool:
    """Return whether a tool can touch: it is present and engaged."""
    return bool(tools.present[tool] and not tools.disengaged[tool])


@kernel
def piece_can_touch(tools: ToolArrays, p: int) -> bool:
    """Return whether a piece can touch: pieces of absent or disengaged tools cannot."""
    return bool(p >= N_TOOL_PIECES or can_touch(tools, p // N_SEGMENTS))


@kernel
def overlap_in_jaws(tools: ToolArrays, p: int, s: float, normal: Vector) -> float:
    """Return the allowed overlap (m) of the wall and a piece: the jaws' indentation, or the rest offset of a hold."""
    return jaw_surface(tools, p, s, normal)[0]


@kernel
def jaw_surface(tools: ToolArrays, p: int, s: float, normal: Vector) -> Surface:
    """Return the surface of piece p for the wall's middle surface, at the parameter ``s`` and along a normal.

    Jaws are round. Along a normal at an angle a to their opening direction, the plane midway between them has the
    distance (r + h / 2) / cos(a) - r from a jaw of radius r, with h the distance of the jaws; of n layers the middle of
    the first one has 1 / n of it. For a = 0 half a layer is thinner by t / 2 - h / 2 n. If the normal does not point
    outwards, in the jaw's opening direction, nothing is squeezed.
    """
    if p >= N_TOOL_PIECES or p % N_SEGMENTS == SHAFT:
        return 0.0, 0.0, 0.0, normal
    tool, jaw = p // N_SEGMENTS, p % N_SEGMENTS
    held_overlap: float = tools.rest_offset[tool, DUCT_TRIANGLE] if tools.held[tool, DUCT_TRIANGLE] else 0.0
    outwards = scaled(row(tools.frame[tool], 0), 1.0 if jaw == JAW_A else -1.0)
    facing, radius = dot(normal, outwards), tools.radius[tool, jaw]
    if facing <= 0.0:
        return held_overlap, held_overlap, 0.0, normal
    cell = min(max(s * N_CELLS - 0.5, 0.0), N_CELLS - 1.0)
    first = min(int(cell), N_CELLS - 2)
    share, depth, slopes = cell - first, tools.indentation[tool], tools.indentation_slope[tool]
    thinning = (1.0 - share) * depth[first] + share * depth[first + 1]
    layers = (1.0 - share) * tools.layers[tool, first] + share * tools.layers[tool, first + 1]
    half = 0.5 * tools.wall_thickness + radius / max(layers, 1.0)
    overlap = (thinning - half * (1.0 - facing)) / facing
    if overlap <= held_overlap:
        return held_overlap, held_overlap, 0.0, normal
    reach = radius + 0.5 * tools.wall_thickness
    turn = (half - thinning) / (facing**2 * (reach - overlap))
    gradient = along(normal, subtract(outwards, scaled(normal, facing)), turn)
    if 0.0 < s < 1.0:  # between its ends a jaw has no normal component along its axis, except by the indentation
        start, end = row_of(tools.segments[tool], jaw, 0), row_of(tools.segments[tool], jaw, 1)
        axis = subtract(end, start)
        depth_slope = N_CELLS * (depth[first + 1] - depth[first]) / facing if 0.0 < cell < N_CELLS - 1.0 else 0.0
        gradient = along(gradient, axis, -(dot(gradient, axis) + depth_slope) / dot(axis, axis))
    size = math.sqrt(dot(gradient, gradient))
    slope = ((1.0 - share) * slopes[first] + share * slopes[first + 1]) / facing
    return overlap, reach - (reach - overlap) / size, slope / size, scaled(gradient, 1.0 / size)
