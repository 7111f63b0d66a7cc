"""From candidate pairs to contact rows: points, frames, levers and gaps with the bodies' present positions."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from services.mechanics.arrays import BoolArray, FloatArray, IntArray
from services.mechanics.bodies.forceps.kinematics import contact_lever
from services.mechanics.collision.pairs import CATHETER_SEGMENT, DUCT_TRIANGLE, NO_TOOL, SHAFT, PairArrays
from services.mechanics.compiled import kernel
from services.mechanics.contact.rows import SURFACE_SOFTNESS_M_N, ContactRows
from services.mechanics.contact.solver import HOLD, UNILATERAL


class ToolGeometry(NamedTuple):
    """Poses of both tools at the start of the step and their motion over it without contact forces."""

    segments: FloatArray  # (2, 3, 2, 3)
    radius: FloatArray  # (2, 3)
    frame: FloatArray  # (2, 3, 3)
    length: FloatArray  # (2,)
    motion: FloatArray  # (2, 4)
    held: BoolArray  # (2, 2) whether the jaws hold something of each target kind


class RodGeometry(NamedTuple):
    """Particles of the catheter at the start of the step and their motion over it without contact forces."""

    position: FloatArray  # (n, 3)
    motion: FloatArray  # (n, 3)
    radius: float


class DuctGeometry(NamedTuple):
    """The undeformed mid-surface of the duct."""

    vertices: FloatArray  # (n, 3)
    triangles: IntArray  # (m, 3)
    half_thickness: float


class ContactGeometry(NamedTuple):
    """Everything that contact rows are built from."""

    tools: ToolGeometry
    rod: RodGeometry
    duct: DuctGeometry


@kernel
def append_pairs(
    pairs: PairArrays, count: int, tools: ToolGeometry, rod: RodGeometry, duct: DuctGeometry, rows: ContactRows
) -> int:
    """Append ``count`` pairs to ``rows`` and return how many found no room.

    Gap and slip still lack the duct's displacement, which needs its modes: see `subtract_duct_motion`. Jaws do
    not collide with what they hold: the hold stands for both of them.
    """
    for index in range(count):
        tool = pairs.tool[index]
        if tool != NO_TOOL and pairs.tool_segment[index] != SHAFT and tools.held[tool, pairs.target_kind[index]]:
            continue
        row = rows.used[0]
        if row == rows.gap_m.shape[0]:
            return count - index
        rows.kind[row] = UNILATERAL
        rows.limit[row] = 0.0
        rows.softness_m_n[row] = SURFACE_SOFTNESS_M_N
        rows.sphere[row] = -1
        rows.duct_weight[row] = 0.0
        rows.rod_weight[row] = 0.0
        rows.tool[row] = pairs.tool[index]
        write_frame(pairs.normal[index], rows.frame[row])
        rows.gap_m[row] = 0.0
        rows.slip_m[row] = 0.0
        if pairs.tool[index] != NO_TOOL:
            _tool_side(pairs, index, tools, rows, row)
        else:
            _catheter_side(pairs, index, rod, rows, row)
        _target_side(pairs, index, rod, duct, rows, row)
        _name(pairs, index, rows, row)
        rows.used[0] = row + 1
    return 0


@kernel
def write_frame(normal: FloatArray, out: FloatArray) -> None:
    """Complete a unit normal to an orthonormal frame in the rows of ``out`` (3, 3).

    Duff et al., "Building an orthonormal basis, revisited", JCGT 6(1), 2017: continuous but at z = 0-.
    """
    x, y, z = normal[0], normal[1], normal[2]
    sign = math.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    out[0, 0], out[0, 1], out[0, 2] = x, y, z
    out[1, 0], out[1, 1], out[1, 2] = 1.0 + sign * x * x * a, sign * b, -sign * x
    out[2, 0], out[2, 1], out[2, 2] = b, sign + y * y * a, -y


@kernel
def _tool_side(pairs: PairArrays, index: int, tools: ToolGeometry, rows: ContactRows, row: int) -> None:
    tool, segment, s = pairs.tool[index], pairs.tool_segment[index], pairs.tool_parameter[index]
    ends = tools.segments[tool, segment]
    normal = pairs.normal[index]
    radius = tools.radius[tool, segment]
    arm = rows.point_m[row]
    for axis in range(3):
        centre = (1.0 - s) * ends[0, axis] + s * ends[1, axis]
        rows.gap_m[row] += normal[axis] * (centre - normal[axis] * radius)
        # J is the start of both jaws; the point becomes absolute again below.
        arm[axis] = centre - normal[axis] * radius - tools.segments[tool, 1, 0, axis]
    lever = rows.lever[row]
    contact_lever(tools.frame[tool], tools.length[tool], segment, arm, lever)
    for axis in range(3):
        arm[axis] += tools.segments[tool, 1, 0, axis]
        for coordinate in range(lever.shape[1]):
            rows.slip_m[row, axis] += lever[axis, coordinate] * tools.motion[tool, coordinate]


@kernel
def _catheter_side(pairs: PairArrays, index: int, rod: RodGeometry, rows: ContactRows, row: int) -> None:
    first, s = pairs.particle[index], pairs.tool_parameter[index]
    second = min(first + 1, rod.position.shape[0] - 1)
    rows.rod_node[row, 0], rows.rod_node[row, 1] = first, second
    rows.rod_weight[row, 0], rows.rod_weight[row, 1] = 1.0 - s, s
    for axis in range(3):
        normal = pairs.normal[index, axis]
        centre = (1.0 - s) * rod.position[first, axis] + s * rod.position[second, axis]
        rows.point_m[row, axis] = centre - normal * rod.radius
        rows.gap_m[row] += normal * rows.point_m[row, axis]
        rows.slip_m[row, axis] = (1.0 - s) * rod.motion[first, axis] + s * rod.motion[second, axis]


@kernel
def _target_side(
    pairs: PairArrays, index: int, rod: RodGeometry, duct: DuctGeometry, rows: ContactRows, row: int
) -> None:
    target = pairs.target[index]
    if pairs.target_kind[index] == CATHETER_SEGMENT:
        rows.gap_m[row] -= rod.radius
        for end in range(2):
            weight = pairs.target_weights[index, end]
            rows.rod_node[row, 2 + end] = target + end
            rows.rod_weight[row, 2 + end] = -weight
            for axis in range(3):
                rows.gap_m[row] -= pairs.normal[index, axis] * weight * rod.position[target + end, axis]
                rows.slip_m[row, axis] -= weight * rod.motion[target + end, axis]
    elif pairs.target_kind[index] == DUCT_TRIANGLE:
        rows.gap_m[row] -= duct.half_thickness
        for corner in range(3):
            node = duct.triangles[target, corner]
            weight = pairs.target_weights[index, corner]
            rows.duct_node[row, corner] = node
            rows.duct_weight[row, corner] = weight
            for axis in range(3):
                rows.gap_m[row] -= pairs.normal[index, axis] * weight * duct.vertices[node, axis]


@kernel
def _name(pairs: PairArrays, index: int, rows: ContactRows, row: int) -> None:
    """Give the pair numbers that are the same in the next tick."""
    first = (np.int64(pairs.tool[index]) + 1) * 4 + pairs.tool_segment[index]
    first = first * (1 << 20) + pairs.particle[index] + 1
    rows.body[row] = first * 2 + pairs.target_kind[index]
    rows.identity[row] = rows.body[row] * (1 << 24) + pairs.target[index]


@kernel
def subtract_duct_motion(
    rows: ContactRows, modes: FloatArray, q: FloatArray, dq: FloatArray, offset: FloatArray, change: FloatArray
) -> None:
    """Take the duct's displacement out of the gaps, and its free motion over the step out of the slips.

    A hold asks for the distance at the end of the step, so it loses the whole displacement.

    Parameters
    ----------
    rows : ContactRows
    modes : (3 k, r) float64
        The modes' rows at the contact points.
    q, dq : (r,) float64
        Modal coordinates at the start of the step and their free change over it.
    offset, change : (k, 3) float64
        Displacement at the start that is not in q (the residual), and its free change over the step.
    """
    for row in range(rows.used[0]):
        for axis in range(3):
            u, du = 0.0, 0.0
            for mode in range(q.shape[0]):
                u += modes[3 * row + axis, mode] * q[mode]
                du += modes[3 * row + axis, mode] * dq[mode]
            rows.gap_m[row] -= rows.frame[row, 0, axis] * (u + offset[row, axis])
            rows.slip_m[row, axis] -= du + change[row, axis]
            if rows.kind[row] == HOLD:
                rows.slip_m[row, axis] -= u + offset[row, axis]
