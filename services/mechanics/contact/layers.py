"""What lies between the jaws of a tool: counted along the line between them, cell by cell.

In the tool's own axes, x in which the jaws open, y along the hinge and z along the shaft, the jaws lie in the plane
y = 0, and the line between them in a cell is parallel to x. So a triangle counts in a cell if its section with that
plane passes between the jaws there. Where the catheter or a stone lies on the line nothing is squeezed: their contacts
know a wall of full thickness.

What lies between the jaws is the triangle of their junction and tips. Most of the listed wall is beside it and stays
so: each triangle of the wall has a lower bound on its distance, and is looked at again when tool and wall have moved by
it, or when a jaw is near it. No point between the jaws moves further than the furthest of the three corners.
"""

from __future__ import annotations

import math
from typing import Annotated

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.bodies.forceps.kinematics import N_CELLS, N_SEGMENTS, tool_frame
from trocar.services.mechanics.collision.candidate_list import CandidateList
from trocar.services.mechanics.collision.pairs import JAW_A, JAW_B
from trocar.services.mechanics.compiled import inlined_kernel, kernel
from trocar.services.mechanics.compiled.struct import Struct
from trocar.services.mechanics.compiled.vectors import (
    Vector,
    along,
    dot,
    put_row_of,
    row,
    row_of,
    squared_distance,
    subtract,
)
from trocar.services.mechanics.contact.geometry import ContactGeometry
from trocar.services.mechanics.scene.tools import N_TOOLS

Jaws = tuple[float, float, float]
"""Length (m) of the jaws, sine and cosine of half their opening."""


class BesideJaws(Struct):
    """Which of the m triangles of a wall cannot have come between the jaws of a tool since they were looked at."""

    bound: Annotated[FloatArray, N_TOOLS, "m"]  # on the distance from what lies between the jaws, plus `travel` then
    corner: Annotated[FloatArray, N_TOOLS, 3, 3]  # junction and tips of the jaws at the last count
    travel: Annotated[FloatArray, N_TOOLS]  # sum of the furthest motions of the corners
    wall_travel: float = 0.0  # of the list at the last count


@kernel
def count_layers(
    listed: CandidateList, beside: BesideJaws, geometry: ContactGeometry, tool: int, frame: FloatArray, out: FloatArray
) -> None:
    """Write how many layers of wall the jaws of a tool have between them at the end of the step, by cells (N_CELLS,).

    A cell without any, beside one with some, has as many: a wall's rim lies between two cells, or just off the tips.
    ``frame`` (3, 3) is scratch.
    """
    tools = geometry.tools
    tool_frame(tools.proxy[tool, :3], tools.port[tool], tools.roll[tool], frame)
    half = 0.5 * tools.proxy[tool, 3]
    jaws, junction = (tools.jaw_length[tool], math.sin(half), math.cos(half)), row(tools.proxy, tool)
    travel = _add_travel(listed, beside, tool, (frame, junction), jaws)
    out[:] = 0.0
    for jaw in (JAW_A, JAW_B):
        piece, side = N_SEGMENTS * tool + jaw, 1.0 if jaw == JAW_A else -1.0
        near = listed.thickness[piece] + listed.wanted[piece] + listed.wall_travel + listed.piece_travel[piece]
        entry, bound, apart = listed.entry[piece], listed.bound[piece], beside.bound[tool]
        for k in range(listed.count[piece]):
            t = entry[k]
            if apart[t] > travel and bound[k] > near:
                continue
            corners = listed.clusters.triangles[t]
            u = _in_tool(frame, subtract(row(listed.position, corners[0]), junction))
            v = _in_tool(frame, subtract(row(listed.position, corners[1]), junction))
            w = _in_tool(frame, subtract(row(listed.position, corners[2]), junction))
            apart[t] = travel + _distance_from_plane(u[1], v[1], w[1])
            _count_triangle((u, v, w), side, jaws, out)
    _spread_to_rims(out)
    _clear_of_bodies(geometry, (frame, junction), jaws, out)


@inlined_kernel
def _add_travel(
    listed: CandidateList, beside: BesideJaws, tool: int, place: tuple[FloatArray, Vector], jaws: Jaws
) -> float:
    """Add the motion of a tool's jaws since its last count to their travel; return that of wall and jaws together.

    Where the list has begun anew, so do the bounds.
    """
    if listed.wall_travel < beside.wall_travel:
        beside.bound[:] = -math.inf
    beside.wall_travel = listed.wall_travel
    (frame, junction), (length_m, sine, cosine) = place, jaws
    ahead, moved_2 = along(junction, row(frame, 2), length_m * cosine), 0.0
    for k in range(3):
        corner = along(ahead, row(frame, 0), (k - 1) * length_m * sine) if k != 1 else junction
        moved_2 = max(moved_2, squared_distance(corner, row_of(beside.corner, tool, k)))
        put_row_of(beside.corner, tool, k, corner)
    beside.travel[tool] += math.sqrt(moved_2)
    return float(listed.wall_travel + beside.travel[tool])


@inlined_kernel
def _distance_from_plane(u: float, v: float, w: float) -> float:
    """Return the distance from y = 0 of a triangle whose corners have these y."""
    return max(min(u, v, w), -max(u, v, w), 0.0)


@inlined_kernel
def _in_tool(frame: FloatArray, arm: Vector) -> Vector:
    return dot(row(frame, 0), arm), dot(row(frame, 1), arm), dot(row(frame, 2), arm)


@inlined_kernel
def _count_triangle(corners: tuple[Vector, Vector, Vector], side: float, jaws: Jaws, out: FloatArray) -> None:
    """Count a triangle in the cells in which it passes between the jaws, on the ``side`` of one of them.

    Each jaw has a list of what is near it, and many triangles are in both.
    """
    u, v, w = corners
    if (u[1] >= 0.0) == (v[1] >= 0.0) == (w[1] >= 0.0):
        return
    if (u[1] >= 0.0) == (w[1] >= 0.0):
        u, v, w = v, w, u
    elif (u[1] >= 0.0) == (v[1] >= 0.0):
        u, v, w = w, u, v
    # u is alone on its side of the plane
    x_1, z_1 = _section(u, v)
    x_2, z_2 = _section(u, w)
    length_m, sine, cosine = jaws
    per_m = N_CELLS / (length_m * cosine)
    first, end = max(int(min(z_1, z_2) * per_m - 0.5), 0), min(int(max(z_1, z_2) * per_m + 1.5), N_CELLS)
    for cell in range(first, end):
        arm_m = length_m * (cell + 0.5) / N_CELLS
        z = arm_m * cosine
        if (z_1 <= z) == (z_2 <= z):
            continue
        x = x_1 + (x_2 - x_1) * (z - z_1) / (z_2 - z_1)
        is_mine = x >= 0.0 if side > 0.0 else x < 0.0
        if is_mine and abs(x) <= arm_m * sine:
            out[cell] += 1.0


@inlined_kernel
def _section(u: Vector, v: Vector) -> tuple[float, float]:
    """Return x and z of the point between two points at which y is zero."""
    share = u[1] / (u[1] - v[1])
    return u[0] + share * (v[0] - u[0]), u[2] + share * (v[2] - u[2])


@inlined_kernel
def _spread_to_rims(counts: FloatArray) -> None:
    """Give a cell without layers, beside one with some, as many as that has."""
    before = 0.0
    for cell in range(N_CELLS):
        own = counts[cell]
        if own == 0.0:
            after = counts[cell + 1] if cell + 1 < N_CELLS else 0.0
            counts[cell] = max(before, after)
        before = own


@inlined_kernel
def _clear_of_bodies(geometry: ContactGeometry, tool: tuple[FloatArray, Vector], jaws: Jaws, out: FloatArray) -> None:
    """Count nothing where the catheter or a stone lies between the jaws."""
    (frame, junction), rod, spheres = tool, geometry.rod, geometry.spheres
    for segment in range(rod.position_now.shape[0] - 1):
        start = _in_tool(frame, subtract(row(rod.position_now, segment), junction))
        end = _in_tool(frame, subtract(row(rod.position_now, segment + 1), junction))
        _clear_of_capsule(start, end, rod.radius[segment], jaws, out)
    for stone in range(spheres.count):
        centre = _in_tool(frame, subtract(row(spheres.start, stone), junction))
        _clear_of_capsule(centre, centre, spheres.radius[stone], jaws, out)


@kernel
def _clear_of_capsule(start: Vector, end: Vector, radius: float, jaws: Jaws, out: FloatArray) -> None:
    """Count nothing where the line between the jaws passes through a capsule."""
    length_m, sine, cosine = jaws
    if min(abs(start[1]), abs(end[1])) > radius and start[1] * end[1] > 0.0:
        return
    way_y, way_z = end[1] - start[1], end[2] - start[2]
    squared = way_y * way_y + way_z * way_z
    for cell in range(N_CELLS):
        arm_m = length_m * (cell + 0.5) / N_CELLS
        from_y, from_z, share = start[1], start[2] - arm_m * cosine, 0.0
        if squared > 0.0:
            share = min(max(-(from_y * way_y + from_z * way_z) / squared, 0.0), 1.0)
        x, y, z = start[0] + share * (end[0] - start[0]), from_y + share * way_y, from_z + share * way_z
        if y * y + z * z < radius * radius and abs(x) <= arm_m * sine:
            out[cell] = 0.0
