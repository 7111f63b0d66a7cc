"""Contact points of a wall whose cross-sections turn: all that a step needs of them, in few kernels.

The compliance beyond the modes is constant along the wall's own axes, so loads are turned back there, and what they
move is turned along.
"""

from __future__ import annotations

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.bodies.contact_corners import ContactCorners, corners_at, list_corners
from trocar.services.mechanics.compiled import kernel, summing_kernel
from trocar.services.mechanics.compiled.struct import Address
from trocar.services.mechanics.reduction.coincident_points import find_sources
from trocar.services.mechanics.reduction.large_rotations.warping_kernels import (
    WarpedTube,
    node_rotations,
    node_rows,
    place_node,
    take_axis,
    tube_at,
    turn_vector,
    turn_vectors,
    update_axis,
)
from trocar.services.mechanics.reduction.node_compliance import (
    Loads,
    NodeArrays,
    PointRows,
    Points,
    displace_corners,
    weigh_turned_blocks,
)

TurnedPlaces = tuple[Address[WarpedTube], Address[NodeArrays], Address[ContactCorners]]
"""The sections, the compliance between nodes that is kept, and the corners of the triangles in contact."""


@kernel
def displace_turned(
    places: TurnedPlaces, points: Points, loads: Loads, slot: IntArray, scratch: tuple[FloatArray, FloatArray]
) -> int:
    """List the corners of points, write what ``loads`` move them by beyond the modes, and return how many there are.

    It is written along world axes, and along those of the wall, as the loads are, into ``scratch``. Less than zero by
    one more than their number where a corner has no place in what is kept; nothing is moved then.
    """
    tube, corners = tube_at(places[0]), corners_at(places[2])
    (nodes, forces), (along_wall, moved) = loads, scratch
    count = list_corners(points[0], points[1], slot, places[2])
    for load in range(nodes.shape[0]):
        turn_vector(tube, nodes[load], True, forces[load], along_wall[load])
    there = nodes, along_wall[: nodes.shape[0]]
    if not displace_corners(places[1], points, there, corners.node[:count], moved[:count]):
        return int(-1 - count)
    for corner in range(count):
        turn_vector(tube, corners.node[corner], False, moved[corner], corners.displacement_m[corner])
    return int(count)


@summing_kernel
def place_points(
    places: TurnedPlaces,
    points: Points,
    corner_rows: FloatArray,
    moved: tuple[FloatArray, FloatArray, FloatArray],
    out: PointRows,
) -> None:
    """Write rows, displacements and motions of points from the rows (u, 3, r) of their corners.

    ``moved`` are the nodes at rest (n, 3), what `displace_turned` wrote along the wall's axes (u, 3), and the free
    change (r,) of the coordinates.
    """
    tube, corners = tube_at(places[0]), corners_at(places[2])
    weights, (rest, beyond, dq), (rows, displacement, motion) = points[1], moved, out
    for corner in range(corner_rows.shape[0]):
        node = corners.node[corner]
        place_node(tube, node, beyond[corner], beyond[corner])
        for axis in range(3):
            beyond[corner, axis] -= rest[node, axis]
    for point in range(weights.shape[0]):
        u, v, w = weights[point, 0], weights[point, 1], weights[point, 2]
        a, b, c = corners.place[point, 0], corners.place[point, 1], corners.place[point, 2]
        for axis in range(3):
            change, lost = 0.0, corners.displacement_m
            for mode in range(dq.shape[0]):
                row = u * corner_rows[a, axis, mode] + v * corner_rows[b, axis, mode] + w * corner_rows[c, axis, mode]
                rows[3 * point + axis, mode] = row
                change += row * dq[mode]
            displacement[point, axis] = u * beyond[a, axis] + v * beyond[b, axis] + w * beyond[c, axis]
            motion[point, axis] = change - (u * lost[a, axis] + v * lost[b, axis] + w * lost[c, axis])


@kernel
def gather_turned(
    places: TurnedPlaces,
    points: Points,
    loads: Loads,
    slot: IntArray,
    scratch: tuple[FloatArray, FloatArray],
    corner_rows: FloatArray,
    still: tuple[FloatArray, FloatArray],
    out: PointRows,
) -> bool:
    """Do as `displace_turned` and `place_points`, with ``still`` = (nodes at rest, free change of the coordinates).

    False where a corner has no place in what is kept; nothing is written to ``out`` then.
    """
    count = displace_turned(places, points, loads, slot, scratch)
    if count < 0:
        return False
    beyond, rows = scratch[1][:count], corner_rows[:count]
    node_rows(places[0], corners_at(places[2]).node[:count], beyond, rows)
    place_points(places, points, rows, (still[0], beyond, still[1]), out)
    return True


@kernel
def weigh_turned(
    places: TurnedPlaces, points: Points, source: IntArray, rotations: FloatArray, out: FloatArray, from_point: int
) -> bool:
    """Write which points are the same, the rotations (3 k, 3, 3) of their corners, and the compliance that is kept.

    The last is written from a point on, and not where a corner has no place there: that returns False.
    """
    find_sources(points, source, from_point)
    node_rotations(places[0], points[0].reshape(-1), rotations)
    return bool(weigh_turned_blocks(places[1], points, rotations, out, source, from_point))


@kernel
def follow_axis(start: Address[WarpedTube], end: Address[WarpedTube], q: FloatArray) -> bool:
    """Bring the axis of the start of a step to q (r,), the end of the last one mostly; False if it is there."""
    return take_axis(tube_at(end), q, tube_at(start))


@kernel
def turn_along(
    start: Address[WarpedTube], end: Address[WarpedTube], q: FloatArray, nodes: IntArray, vectors: FloatArray
) -> None:
    """Turn vectors (k, 3) of nodes (k,), in place, as their sections turn from the start to where q (r,) puts them."""
    update_axis(end, q)
    turn_vectors(start, nodes, True, vectors, vectors)
    turn_vectors(end, nodes, False, vectors, vectors)
