"""Compliance between the nodes of a duct that contacts touch, cached from tick to tick.

Contact points move over their triangles in every tick, but the compliance C between nodes never changes. So W between
contact points is B C B^T with the barycentric weights B, and most blocks of C are known already. A new node costs its
row of residual blocks, scattered over 36 n^2 bytes, and r products a block.

The cache depends on the pair of nodes only, not on its own history: C of the same nodes is the same to the last bit.
That holds while the modes are those of the undeformed wall. Sections that turn carry the modes along, so of a wall with
large rotations only the residual is kept, along the wall's own axes, and turned with the points (`bodies.wall_motion`).

What loads move points by and W are sums of the same numbers, the residual in single precision as it is stored: steady
forces then move nothing. With W rounded to single precision what sticks crept by 30 nm a second at 10 kHz.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from trocar.services.mechanics.arrays import BoolArray, Float32Array, FloatArray, IntArray, LongArray
from trocar.services.mechanics.compiled import inlined_kernel, kernel, summing_kernel
from trocar.services.mechanics.compiled.struct import Address, Struct, reader
from trocar.services.mechanics.reduction.basis import gather_modes
from trocar.services.mechanics.reduction.coincident_points import is_copied
from trocar.services.mechanics.reduction.reduced_duct import ReducedDuct
from trocar.services.mechanics.reduction.residual.blocks import BlockStore, block_between, store_at
from trocar.services.mechanics.reduction.touched_nodes import (
    N_PLACES,
    NO_PLACE,
    TouchedNodes,
    begin_tick,
    give_place,
    touch,
)

Points = tuple[IntArray, FloatArray]
"""Points of triangles: nodes (k, 3) and barycentric weights (k, 3), all zero where a point is not on the duct."""
Loads = tuple[IntArray, FloatArray]
"""Nodes (l,) and forces (l, 3)."""
PointRows = tuple[FloatArray, FloatArray, FloatArray]
"""Rows of the modes (3 k, r) at points, their displacements (k, 3), and their motions without contact (k, 3)."""

MOST_NEW_BLOCKS = 400
"""Modal blocks computed in a tick at most: 30 us on a slow machine. Until all are there W is gathered anew."""


class NodeArrays(Struct):
    """Compliance between m places of nodes, of n in the mesh, with r modes."""

    touched: TouchedNodes
    Phi: Annotated[FloatArray, "n", 3, "r"]
    residual: Annotated[Float32Array, "3 m", "3 m"]  # item 3 q + j, 3 p + i: how j at q moves i at p
    whole: Annotated[FloatArray, "3 m", "3 m"]  # with the modes, between places whose flag is set
    has_modes: Annotated[BoolArray, "m"]
    gain: Annotated[FloatArray, "r"]  # with which `whole` was made
    moved: Annotated[FloatArray, "3 m"]  # scratch: displacements of the nodes
    rows: Annotated[FloatArray, 3, "3 m"]  # scratch: compliance between a point and the nodes
    first: Annotated[LongArray, "k", 3]  # scratch: the first column of each corner of the points


arrays_at = reader(NodeArrays)


class NodeCompliance:
    """Compliance of a duct in contact, from blocks between nodes that are kept.

    Args:
        n_points: int. Contact points there is room for.
        n_places: int. How many nodes are followed; where contacts touch more, every tick gathers anew.
    """

    def __init__(self, duct: ReducedDuct, n_points: int, n_places: int = N_PLACES) -> None:
        touched = TouchedNodes.of(duct.mesh.n_vertices, n_places)
        m = len(touched.node)
        self._store = duct.residual.store
        self._arrays = NodeArrays.zeros(
            touched=touched, Phi=duct.basis.Phi, gain=np.zeros(duct.basis.n_modes), m=m, k=n_points, **{"3 m": 3 * m}
        )
        self.address = self._arrays.address

    def displace(self, points: Points, loads: Loads, out: tuple[FloatArray, FloatArray]) -> bool:
        """Add what ``loads`` move points by beyond the modes to displacements, and take it from motions, (k, 3) in m.

        Once in every tick with contacts. False, and nothing added, where a node finds no place.
        """
        address = self._arrays.address
        if displace_points(address, points, loads, out):
            return True
        if not admit_nodes(address, self._store.address, points, loads):
            return False
        return bool(displace_points(address, points, loads, out))

    def gather_points(
        self, points: Points, motion: tuple[FloatArray, FloatArray], loads: Loads, out: PointRows
    ) -> bool:
        """Gather modes, displacements and motions of points, see `gather_modes`, and `displace` them."""
        if gather_and_displace(self._arrays.address, points, motion, loads, out):
            return True
        return self.displace(points, loads, (out[1], out[2]))

    def gather(self, points: Points, gain: FloatArray, out: FloatArray, first: int) -> bool:
        """Write the compliance between the points of the last `displace` into the lower blocks of ``out`` (3 k, 3 k).

        From point ``first`` on: what couples those before it is left as it is.
        ``gain`` (r,) is that of the modes; another than in the last tick makes all of it anew. False, and nothing
        written, while blocks are missing.
        """
        return bool(weigh_blocks(self._arrays.address, points, gain, out, first))

    def displace_corners(self, points: Points, loads: Loads, corners: IntArray, out: FloatArray) -> bool:
        """Write what ``loads`` move the nodes of points, ``corners`` (u,), by beyond the modes: (u, 3) in m.

        All along the wall's own axes. False, and nothing written, where a node finds no place.
        """
        address = self._arrays.address
        if displace_corners(address, points, loads, corners, out):
            return True
        if not admit_nodes(address, self._store.address, points, loads):
            return False
        return bool(displace_corners(address, points, loads, corners, out))


@kernel
def displace_points(
    address: Address[NodeArrays], points: Points, loads: Loads, out: tuple[FloatArray, FloatArray]
) -> bool:
    """Add the residual displacements of points and return True, or return False where a node has no place."""
    return bool(_displace_points(arrays_at(address), points, loads, out))


@kernel
def gather_and_displace(
    address: Address[NodeArrays], points: Points, motion: tuple[FloatArray, FloatArray], loads: Loads, out: PointRows
) -> bool:
    """Write modes, displacements and motions of points, then do as `displace_points`: what a tick begins with."""
    kept = arrays_at(address)
    gather_modes(points, kept.Phi, motion, out)
    return bool(_displace_points(kept, points, loads, (out[1], out[2])))


@kernel
def _displace_points(kept: NodeArrays, points: Points, loads: Loads, out: tuple[FloatArray, FloatArray]) -> bool:
    begin_tick(kept.touched)
    if not _touch_all(kept.touched, points, loads):
        return False
    _move_nodes(kept, loads)
    (nodes, weights), place, moved = points, kept.touched.place, kept.moved
    for point in range(nodes.shape[0]):
        for axis in range(3):
            total = 0.0
            for corner in range(3):
                if weights[point, corner] != 0.0:
                    total += weights[point, corner] * moved[3 * place[nodes[point, corner]] + axis]
            out[0][point, axis] += total
            out[1][point, axis] -= total
    return True


@kernel
def displace_corners(
    address: Address[NodeArrays], points: Points, loads: Loads, corners: IntArray, out: FloatArray
) -> bool:
    """Write the residual displacements of the corners and return True, or return False where a node has no place."""
    kept = arrays_at(address)
    begin_tick(kept.touched)
    if not _touch_all(kept.touched, points, loads):
        return False
    _move_nodes(kept, loads)
    for corner in range(corners.shape[0]):
        first = 3 * kept.touched.place[corners[corner]]
        for axis in range(3):
            out[corner, axis] = kept.moved[first + axis]
    return True


@kernel
def _touch_all(touched: TouchedNodes, points: Points, loads: Loads) -> bool:
    (nodes, weights), has_all = points, True
    for point in range(nodes.shape[0]):
        for corner in range(3):
            if weights[point, corner] != 0.0:
                has_all = touch(touched, nodes[point, corner]) and has_all
    for load in range(loads[0].shape[0]):
        has_all = touch(touched, loads[0][load]) and has_all
    return has_all


@kernel
def _move_nodes(kept: NodeArrays, loads: Loads) -> None:
    """Write what loads move all the nodes by that have a place; those without a node hold numbers without meaning."""
    nodes, force = loads
    residual, moved, n = kept.residual, kept.moved, 3 * kept.touched.extent
    for item in range(n):
        moved[item] = 0.0
    for load in range(nodes.shape[0]):
        row = 3 * kept.touched.place[nodes[load]]
        x, y, z = force[load, 0], force[load, 1], force[load, 2]
        for item in range(n):
            moved[item] += residual[row, item] * x + residual[row + 1, item] * y + residual[row + 2, item] * z


@kernel
def admit_nodes(address: Address[NodeArrays], store_address: Address[BlockStore], points: Points, loads: Loads) -> bool:
    """Give every node of points and loads a place; return False where there are too few places."""
    store = store_at(store_address)
    kept, (nodes, weights), has_all = arrays_at(address), points, True
    for point in range(nodes.shape[0]):
        for corner in range(3):
            if weights[point, corner] != 0.0:
                has_all = _admit(kept, store, nodes[point, corner]) and has_all
    for load in range(loads[0].shape[0]):
        has_all = _admit(kept, store, loads[0][load]) and has_all
    return has_all


@kernel
def _admit(kept: NodeArrays, store: BlockStore, node: int) -> bool:
    if kept.touched.place[node] != NO_PLACE:
        return True
    place = give_place(kept.touched, node)
    if place == NO_PLACE:
        return False
    kept.has_modes[place] = False
    for other in range(kept.touched.extent):
        if kept.touched.node[other] >= 0:
            _copy_blocks(kept, store, place, other)
    return True


@inlined_kernel
def _copy_blocks(kept: NodeArrays, store: BlockStore, first: int, second: int) -> None:
    """Copy the block of two places and its transpose."""
    block = block_between(store, kept.touched.node[first], kept.touched.node[second])
    for i in range(3):
        for j in range(3):
            kept.residual[3 * first + i, 3 * second + j] = block[3 * i + j]
            kept.residual[3 * second + j, 3 * first + i] = block[3 * i + j]


@kernel
def weigh_blocks(
    address: Address[NodeArrays], points: Points, gain: FloatArray, out: FloatArray, from_point: int
) -> bool:
    """Write B C B^T into the lower blocks of ``out``, from a point on, or return False while C is not complete."""
    kept, (nodes, weights) = arrays_at(address), points
    _take_gain(kept, gain)
    if not _complete(kept, points):
        return False
    place, first, rows = kept.touched.place, kept.first, kept.rows
    for a in range(nodes.shape[0]):
        for corner in range(3):
            is_used = weights[a, corner] != 0.0
            first[a, corner] = 3 * place[nodes[a, corner]] if is_used else 0
        if a < from_point:
            continue
        if weights[a, 0] == 0.0 and weights[a, 1] == 0.0 and weights[a, 2] == 0.0:
            _clear_rows(out, a)
            continue
        _weigh_rows(kept, a, weights)
        for b in range(a + 1):
            u, v, w = weights[b, 0], weights[b, 1], weights[b, 2]
            p, q, r = first[b, 0], first[b, 1], first[b, 2]
            for i in range(3):
                for j in range(3):
                    out[3 * a + i, 3 * b + j] = u * rows[i, p + j] + v * rows[i, q + j] + w * rows[i, r + j]
    return True


@inlined_kernel
def _clear_rows(out: FloatArray, a: int) -> None:
    for i in range(3):
        for column in range(3 * a + 3):
            out[3 * a + i, column] = 0.0


@inlined_kernel
def _weigh_rows(kept: NodeArrays, point: int, weights: FloatArray) -> None:
    """Write the compliance between a point and all places into ``rows``."""
    whole, rows, first = kept.whole, kept.rows, kept.first
    u, v, w = weights[point, 0], weights[point, 1], weights[point, 2]
    p, q, r = first[point, 0], first[point, 1], first[point, 2]
    for i in range(3):
        for column in range(3 * kept.touched.extent):
            rows[i, column] = u * whole[p + i, column] + v * whole[q + i, column] + w * whole[r + i, column]


@kernel
def weigh_turned_blocks(
    address: Address[NodeArrays],
    points: Points,
    rotations: FloatArray,
    out: FloatArray,
    source: IntArray,
    from_point: int,
) -> bool:
    """Write B Q R Q^T B^T into the lower blocks of ``out``, from a point on, or return False where a node has no place.

    ``rotations`` (3 k, 3, 3) are Q of the corners; blocks that ``source`` (k,) says are copies are left out.
    """
    kept, (nodes, weights), place = arrays_at(address), points, arrays_at(address).touched.place
    for point in range(nodes.shape[0]):
        for corner in range(3):
            if weights[point, corner] != 0.0 and place[nodes[point, corner]] == NO_PLACE:
                return False
    for a in range(from_point, nodes.shape[0]):
        _weigh_turned_rows(kept, a, points, rotations)
        for b in range(a + 1):
            if not is_copied(source, a, b):
                _turn_block(kept, b, points, rotations, out[3 * a :, 3 * b :])
    return True


@kernel
def _weigh_turned_rows(kept: NodeArrays, point: int, points: Points, rotations: FloatArray) -> None:
    """Write B Q R between a point and all places into ``rows``."""
    (nodes, weights), residual, rows = points, kept.residual, kept.rows
    for i in range(3):
        for column in range(3 * kept.touched.extent):
            rows[i, column] = 0.0
    for corner in range(3):
        weight, Q = weights[point, corner], rotations[3 * point + corner]
        if weight == 0.0:
            continue
        first = 3 * kept.touched.place[nodes[point, corner]]
        for i in range(3):
            x, y, z = weight * Q[i, 0], weight * Q[i, 1], weight * Q[i, 2]
            for column in range(3 * kept.touched.extent):
                more = x * residual[first, column] + y * residual[first + 1, column] + z * residual[first + 2, column]
                rows[i, column] += more


@kernel
def _turn_block(kept: NodeArrays, point: int, points: Points, rotations: FloatArray, out: FloatArray) -> None:
    """Write ``rows`` Q^T B^T of a point over the first block of ``out``."""
    (nodes, weights), rows = points, kept.rows
    for i in range(3):
        for j in range(3):
            out[i, j] = 0.0
    for corner in range(3):
        weight, Q = weights[point, corner], rotations[3 * point + corner]
        if weight == 0.0:
            continue
        first = 3 * kept.touched.place[nodes[point, corner]]
        for i in range(3):
            x, y, z = weight * rows[i, first], weight * rows[i, first + 1], weight * rows[i, first + 2]
            for j in range(3):
                out[i, j] += x * Q[j, 0] + y * Q[j, 1] + z * Q[j, 2]


@inlined_kernel
def _take_gain(kept: NodeArrays, gain: FloatArray) -> None:
    """Invalidate the blocks if the gain has changed, as it does with the step length."""
    is_same = True
    for mode in range(gain.shape[0]):
        is_same = is_same and kept.gain[mode] == gain[mode]
    if not is_same:
        for mode in range(gain.shape[0]):
            kept.gain[mode] = gain[mode]
        for place in range(kept.has_modes.shape[0]):
            kept.has_modes[place] = False


@inlined_kernel
def _complete(kept: NodeArrays, points: Points) -> bool:
    """Compute missing rows of C, as many as a tick has time for, and return whether none is missing."""
    (nodes, weights), left, is_complete = points, MOST_NEW_BLOCKS, True
    for point in range(nodes.shape[0]):
        for corner in range(3):
            if weights[point, corner] == 0.0:
                continue
            place = kept.touched.place[nodes[point, corner]]
            if place == NO_PLACE:
                is_complete = False
            elif not kept.has_modes[place]:
                if left > 0:
                    left -= _add_modes(kept, place)
                else:
                    is_complete = False
    return is_complete


@inlined_kernel
def _add_modes(kept: NodeArrays, place: int) -> int:
    """Fill the rows and columns of a place in C and return how many blocks that were."""
    kept.has_modes[place] = True
    count = 0
    for other in range(kept.touched.extent):
        if kept.touched.node[other] >= 0 and kept.has_modes[other]:
            _fill_block(kept, place, other)
            count += 1
    return count


@inlined_kernel
def _fill_block(kept: NodeArrays, first: int, second: int) -> None:
    """Write C between two places: the modes' part and the residual.

    The modes of the node with the lower number are scaled, whichever was there first: C does not depend on that.
    """
    node, residual, whole = kept.touched.node, kept.residual, kept.whole
    if node[first] > node[second]:
        first, second = second, first
    for i in range(3):
        row, products = 3 * first + i, _products(kept, node[first], i, node[second])
        for j in range(i if first == second else 0, 3):
            column = 3 * second + j
            value = products[j] + residual[row, column]
            whole[row, column] = value
            whole[column, row] = value


@summing_kernel
def _products(kept: NodeArrays, first: int, axis: int, second: int) -> tuple[float, float, float]:
    """Sum the scaled products of the modes of one node along an axis with those of another along all three."""
    Phi, gain = kept.Phi, kept.gain
    x, y, z = 0.0, 0.0, 0.0
    for mode in range(gain.shape[0]):
        scaled = Phi[first, axis, mode] * gain[mode]
        x, y, z = (
            x + scaled * Phi[second, 0, mode],
            y + scaled * Phi[second, 1, mode],
            z + scaled * Phi[second, 2, mode],
        )
    return x, y, z
