"""Functions that write contact rows; no other module does. They begin a row, and set its first body and its target."""

from __future__ import annotations

import math

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.bodies.forceps.kinematics import contact_lever
from trocar.services.mechanics.bodies.forceps.tool_body import ToolArrays
from trocar.services.mechanics.collision.pairs import NO_TOOL
from trocar.services.mechanics.compiled import inlined_kernel, kernel
from trocar.services.mechanics.compiled.vectors import Vector, cross, subtract
from trocar.services.mechanics.compiled.vectors import row as vector
from trocar.services.mechanics.compiled.vectors import row_of as vector_of
from trocar.services.mechanics.contact.identity import with_law
from trocar.services.mechanics.contact.laws import CREEP, SOFTNESS_M_N
from trocar.services.mechanics.contact.rows import NO_STONE, PRESENT, ContactRows

NO_ROOM = -1
# Index of the first of two particles of each side in ``rod_node``.
FIRST_SIDE, TARGET_SIDE = 0, 2
# Index of the first of three particles of a target on the curve; the first body of such a row is not the catheter.
_ON_CURVE = 1


@kernel
def n_free_rows(rows: ContactRows) -> int:
    """Return how many more rows can be appended."""
    return int(max(rows.gap_m.shape[0] - rows.reserved - rows.n_contacts, 0))


@kernel
def append_row(rows: ContactRows, law: int, identity: int) -> int:
    """Append a row under a law, without bodies, gap, slip or force, and return its index.

    If there is no room, the row is counted as dropped, and `NO_ROOM` is returned.
    """
    row = rows.n_contacts
    if n_free_rows(rows) == 0:
        rows.dropped += 1
        return NO_ROOM
    rows.n_contacts = row + 1
    rows.identity[row] = identity
    rows.tool[row], rows.stone[row] = NO_TOOL, NO_STONE
    rows.duct_weight[row] = 0.0
    rows.rod_weight[row] = 0.0
    rows.gap_m[row] = rows.rest_offset_m[row] = rows.correction_m[row] = rows.sunk_m[row] = 0.0
    rows.slip_m[row] = rows.elastic_m[row] = rows.force_n[row] = 0.0
    rows.friction[row], rows.pressure_n[row], rows.friction_energy_j[row] = 0.0, PRESENT, 0.0
    rows.slid_m[row] = -1.0
    set_law(rows, row, law)
    return row


@inlined_kernel
def set_law(rows: ContactRows, row: int, law: int) -> None:
    """Set the law of a row, and with it its softness, without a limit on its force."""
    rows.law[row], rows.force_limit_n[row] = law, math.inf
    for axis in range(3):
        rows.softness_m_n[row, axis] = SOFTNESS_M_N[law, axis]
    rows.softness_m_n[row, 0] += CREEP[law] * rows.dt_s


@kernel
def append_copy(rows: ContactRows, source: int, law: int) -> int:
    """Append a copy of a row's points, frame and slip under another law, and return its index or `NO_ROOM`."""
    row: int = append_row(rows, law, with_law(rows.identity[source], law))
    if row == NO_ROOM:
        return row
    rows.tool[row], rows.stone[row] = rows.tool[source], rows.stone[source]
    put_on_duct(rows, row, rows.duct_node[source], rows.duct_weight[source])
    for axis in range(3):
        rows.point_m[row, axis] = rows.point_m[source, axis]
        rows.slip_m[row, axis] = rows.slip_m[source, axis]
        for other in range(3):
            rows.frame[row, axis, other] = rows.frame[source, axis, other]
        for coordinate in range(rows.lever.shape[2]):
            rows.lever[row, axis, coordinate] = rows.lever[source, axis, coordinate]
    for point in range(rows.rod_node.shape[1]):
        rows.rod_node[row, point] = rows.rod_node[source, point]
        rows.rod_weight[row, point] = rows.rod_weight[source, point]
    return row


@kernel
def put_on_tool(rows: ContactRows, row: int, tools: ToolArrays, tool: int, segment: int) -> None:
    """Make a tool the first body. On entry ``point_m`` of the row is relative to J; it becomes absolute."""
    arm, lever = rows.point_m[row], rows.lever[row]
    rows.tool[row] = tool
    contact_lever(tools.frame[tool], tools.length[tool], segment, arm, lever)
    for axis in range(3):
        arm[axis] += tools.segments[tool, 1, 0, axis]


@kernel
def add_tool_motion(rows: ContactRows, row: int, tools: ToolArrays) -> None:
    """Add the motion of the tool's point over the step to the slip; roll is positive about minus the shaft's axis."""
    lever, tool = rows.lever[row], rows.tool[row]
    arm = subtract(vector(rows.point_m, row), vector_of(tools.segments[tool], 1, 0))
    turn = cross(arm, vector_of(tools.frame, tool, 2))
    for axis in range(3):
        rows.slip_m[row, axis] += tools.rolled[tool] * turn[axis]
        for coordinate in range(lever.shape[1]):
            rows.slip_m[row, axis] += lever[axis, coordinate] * tools.motion[tool, coordinate]


@kernel
def put_on_rod(rows: ContactRows, row: int, side: int, nodes: tuple[int, int], weights: tuple[float, float]) -> None:
    """Put one side of a row between two particles of the catheter; weights of the target side are negative."""
    rows.rod_node[row, side], rows.rod_node[row, side + 1] = nodes[0], nodes[1]
    rows.rod_weight[row, side], rows.rod_weight[row, side + 1] = weights[0], weights[1]


@inlined_kernel
def put_on_curve(rows: ContactRows, row: int, first: int, weights: Vector) -> None:
    """Put the target on the catheter's curve: on three particles from ``first`` on, with ``weights`` as in `curve`."""
    for k in range(3):
        rows.rod_node[row, _ON_CURVE + k], rows.rod_weight[row, _ON_CURVE + k] = first + k, -weights[k]


@kernel
def put_on_duct(rows: ContactRows, row: int, corners: IntArray, weights: FloatArray) -> None:
    """Put the target on the duct: in the triangle with nodes ``corners`` (3,), at barycentric ``weights`` (3,)."""
    for corner in range(3):
        rows.duct_node[row, corner] = corners[corner]
        rows.duct_weight[row, corner] = weights[corner]
