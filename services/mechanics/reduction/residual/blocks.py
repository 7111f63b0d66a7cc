"""Residual compliance: the static response of all the modes that were left out.

A truncated basis is too stiff exactly where a forceps pinches. The lost part of a static response,
R = K^-1 - Phi Lambda^-1 Phi^T, restores it: u_i = Phi_i q + sum_j R_ij f_j over the loaded nodes j. The modes
left out are faster than what the hand feels, so their response is taken as immediate (static correction, the
mode acceleration method; Craig and Kurdila, "Fundamentals of Structural Dynamics").
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from trocar.services.mechanics.arrays import Float32Array, FloatArray, IntArray, LongArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Address, Struct, reader
from trocar.services.mechanics.reduction.coincident_points import is_copied
from trocar.services.mechanics.surface.cyclic_symmetry import CyclicSymmetry

BlockArray = Float32Array | FloatArray
Block = tuple[float, float, float, float, float, float, float, float, float]
"""The nine numbers of a block, row after row."""


class BlockStore(Struct):
    """Blocks as kernels read them: of all pairs of nodes, of those of one sector, or within a patch radius.

    Attributes:
        blocks: (p, 3, 3) float32, which rounds each entry by 1e-7. With all pairs p = n^2, row after row.
        starts: (n + 1,) int32. With patches, the blocks of node i are ``starts[i]`` to ``starts[i + 1]``; else empty.
        neighbours: (p,) int32. With patches, the other node of each block, ascending in a row; else empty.
        seat, sector: (n,) int32, turns: (m, 2) float64, odd: (n, 3, o) float64. Of blocks in the frames of m sectors,
            see `Residual.cyclic`; else empty.
        n_nodes: int. Nodes of the mesh, n.
    """

    blocks: Annotated[Float32Array, "p", 3, 3]
    starts: Annotated[IntArray, "s"]
    neighbours: Annotated[IntArray, "k"]
    seat: Annotated[IntArray, "c"]
    sector: Annotated[IntArray, "c"]
    turns: Annotated[FloatArray, "m", 2]
    odd: Annotated[FloatArray, "c", 3, "o"]
    n_nodes: int

    @classmethod
    def of(cls, n_nodes: int, blocks: BlockArray, **given: IntArray | FloatArray) -> BlockStore:
        """Return a store of these blocks; the arrays that are not given are empty."""
        rounded = np.ascontiguousarray(blocks, np.float32)
        empty = dict.fromkeys("skcmo", 0)
        return cls.zeros(n_nodes=n_nodes, blocks=rounded, **given, **empty)


store_at = reader(BlockStore)


@dataclass(frozen=True, slots=True)
class Residual:
    """R as 3 x 3 blocks between pairs of nodes, in m/N: all pairs, those of one sector, or those within a patch radius.

    Reading blocks allocates nothing and costs the same whatever the size of the mesh.
    """

    store: BlockStore

    @property
    def n_nodes(self) -> int:
        """Number of nodes of the mesh."""
        return self.store.n_nodes

    @property
    def blocks(self) -> Float32Array:
        """The stored blocks (p, 3, 3)."""
        return self.store.blocks

    @classmethod
    def full(cls, blocks: BlockArray) -> Residual:
        """Wrap the blocks (n, n, 3, 3) between all pairs of nodes. Raises ValueError if the array has another shape."""
        if blocks.ndim != 4 or blocks.shape[0] != blocks.shape[1] or blocks.shape[2:] != (3, 3):
            raise ValueError(f"residual blocks have shape {blocks.shape}, expected (n, n, 3, 3)")
        return cls(BlockStore.of(blocks.shape[0], blocks.reshape(-1, 3, 3)))

    @classmethod
    def cyclic(cls, symmetry: CyclicSymmetry, blocks: BlockArray, odd: FloatArray) -> Residual:
        """Wrap the blocks of a sector: between nodes a and b, F_a (B - l_a l_b^T) F_b^T.

        F turns a sector's frame into the world's.

        Args:
            symmetry: CyclicSymmetry. k nodes in each of m sectors.
            blocks: (k, k, m, 3, 3) float32. B of two seats whose sectors are 0 to m - 1 apart.
            odd: (k m, 3, o) float64. l: modes over their frequency, in the nodes' own frames, that are in the basis and
                whose partners are not.
        """
        m, n = symmetry.n_sectors, len(symmetry.seat)
        if blocks.shape != (n // m, n // m, m, 3, 3):
            raise ValueError(f"residual blocks have shape {blocks.shape}, expected {(n // m, n // m, m, 3, 3)}")
        seat, sector, turns = symmetry.seat, symmetry.sector, symmetry.turns
        return cls(BlockStore.of(n, blocks.reshape(-1, 3, 3), seat=seat, sector=sector, turns=turns, odd=odd))

    @classmethod
    def patches(cls, starts: IntArray, neighbours: IntArray, blocks: BlockArray) -> Residual:
        """Wrap compressed rows of blocks; pairs without a block count as zero."""
        if blocks.shape != (neighbours.size, 3, 3):
            raise ValueError(f"residual blocks have shape {blocks.shape}, expected ({neighbours.size}, 3, 3)")
        return cls(BlockStore.of(starts.size - 1, blocks, starts=starts, neighbours=neighbours))

    @classmethod
    def none(cls, n_nodes: int) -> Residual:
        """Return the residual of a bare truncated basis, for comparison: every left-out mode is rigid."""
        return cls(BlockStore.of(n_nodes, np.zeros((0, 3, 3)), starts=np.zeros(n_nodes + 1, np.int32)))

    def gather_points(self, nodes: IntArray, weights: FloatArray, out: FloatArray, source: IntArray) -> None:
        """Write R between points of triangles into ``out`` (3 k, 3 k).

        ``nodes`` (k, 3) are the corners and ``weights`` (k, 3) the barycentric coordinates of each point. Blocks
        that ``source`` (k,) says are copies are left out, see `coincident_points`.
        """
        gather_points(self.store.address, nodes, weights, out, source)

    def apply(self, load_nodes: IntArray, load_forces: FloatArray, nodes: IntArray, out: FloatArray) -> None:
        """Add to ``out`` (k, 3), in m, what ``load_forces`` (l, 3) in N on ``load_nodes`` (l,) do to ``nodes``."""
        apply(self.store.address, load_nodes, load_forces, nodes, out)


# The kernels index whole arrays instead of slicing blocks out of them: a slice is a descriptor of ten words, which
# costs more than the nine products of a block.


@kernel
def find_sorted(values: IntArray, first: int, end: int, wanted: int) -> int:
    """Return where ``wanted`` stands among the ascending ``values[first:end]``, -1 where it does not."""
    low, high = first, end
    while low < high:
        middle = (low + high) // 2
        if values[middle] < wanted:
            low = middle + 1
        else:
            high = middle
    return int(low) if low < end and values[low] == wanted else -1


@kernel
def block_index(store: BlockStore, row: int, column: int) -> int:
    """Return where the block of two nodes lies, -1 where there is none."""
    seat, sector, starts = store.seat, store.sector, store.starts
    if seat.shape[0] > 0:
        m = store.turns.shape[0]
        apart = sector[column] - sector[row]
        return int((seat[row] * (store.n_nodes // m) + seat[column]) * m + (apart if apart >= 0 else apart + m))
    if starts.shape[0] == 0:
        return int(row * store.n_nodes + column)
    return int(find_sorted(store.neighbours, starts[row], starts[row + 1], column))


@kernel
def block_between(store: BlockStore, row: int, column: int) -> Block:
    """Return R of two nodes along world axes, zero where there is none.

    R is symmetric, but each stored block is rounded for itself. So of both blocks of two nodes only that in the row of
    the lower node is ever read, and transposed where the other one is wanted.
    """
    if row <= column:
        return _stored_block(store, row, column)
    xx, xy, xz, yx, yy, yz, zx, zy, zz = _stored_block(store, column, row)
    return (xx, yx, zx, xy, yy, zy, xz, yz, zz)


@kernel
def _stored_block(store: BlockStore, row: int, column: int) -> Block:
    blocks, place = store.blocks, block_index(store, row, column)
    if place < 0:
        return (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    xx, xy, xz = float(blocks[place, 0, 0]), float(blocks[place, 0, 1]), float(blocks[place, 0, 2])
    yx, yy, yz = float(blocks[place, 1, 0]), float(blocks[place, 1, 1]), float(blocks[place, 1, 2])
    zx, zy, zz = float(blocks[place, 2, 0]), float(blocks[place, 2, 1]), float(blocks[place, 2, 2])
    if store.seat.shape[0] == 0:
        return (xx, xy, xz, yx, yy, yz, zx, zy, zz)
    sector, turns, odd = store.sector, store.turns, store.odd
    for k in range(odd.shape[2]):
        ux, uy, uz = odd[row, 0, k], odd[row, 1, k], odd[row, 2, k]
        vx, vy, vz = odd[column, 0, k], odd[column, 1, k], odd[column, 2, k]
        xx, xy, xz = xx - ux * vx, xy - ux * vy, xz - ux * vz
        yx, yy, yz = yx - uy * vx, yy - uy * vy, yz - uy * vz
        zx, zy, zz = zx - uz * vx, zy - uz * vy, zz - uz * vz
    c, s = turns[sector[row], 0], turns[sector[row], 1]
    yx, zx = c * yx - s * zx, s * yx + c * zx
    yy, zy = c * yy - s * zy, s * yy + c * zy
    yz, zz = c * yz - s * zz, s * yz + c * zz
    c, s = turns[sector[column], 0], turns[sector[column], 1]
    xy, xz = c * xy - s * xz, s * xy + c * xz
    yy, yz = c * yy - s * yz, s * yy + c * yz
    zy, zz = c * zy - s * zz, s * zy + c * zz
    return (xx, xy, xz, yx, yy, yz, zx, zy, zz)


@kernel
def gather_points(
    address: Address[BlockStore], nodes: IntArray, weights: FloatArray, out: FloatArray, source: IntArray
) -> None:
    """Weigh the blocks between the corners of points (k, 3) into ``out`` (3 k, 3 k)."""
    store = store_at(address)
    for a in range(nodes.shape[0]):
        for b in range(a + 1):
            if is_copied(source, a, b):
                continue
            xx, xy, xz, yx, yy, yz, zx, zy, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for corner in range(3):
                for other in range(3):
                    weight = weights[a, corner] * weights[b, other]
                    if weight == 0.0:
                        continue
                    block = block_between(store, nodes[a, corner], nodes[b, other])
                    xx, xy, xz = xx + weight * block[0], xy + weight * block[1], xz + weight * block[2]
                    yx, yy, yz = yx + weight * block[3], yy + weight * block[4], yz + weight * block[5]
                    zx, zy, zz = zx + weight * block[6], zy + weight * block[7], zz + weight * block[8]
            row, column = 3 * a, 3 * b
            out[row, column], out[row, column + 1], out[row, column + 2] = xx, xy, xz
            out[row + 1, column], out[row + 1, column + 1], out[row + 1, column + 2] = yx, yy, yz
            out[row + 2, column], out[row + 2, column + 1], out[row + 2, column + 2] = zx, zy, zz
            for i in range(3):
                for j in range(3):
                    out[column + j, row + i] = out[row + i, column + j]


@kernel
def apply(
    address: Address[BlockStore], load_nodes: IntArray, load_forces: FloatArray, nodes: IntArray, out: FloatArray
) -> None:
    """Add R f of the loads (l, 3) to the displacements ``out`` (k, 3) of ``nodes``."""
    store = store_at(address)
    for a in range(nodes.shape[0]):
        x, y, z = 0.0, 0.0, 0.0
        for b in range(load_nodes.shape[0]):
            block = block_between(store, nodes[a], load_nodes[b])
            fx, fy, fz = load_forces[b, 0], load_forces[b, 1], load_forces[b, 2]
            x += block[0] * fx + block[1] * fy + block[2] * fz
            y += block[3] * fx + block[4] * fy + block[5] * fz
            z += block[6] * fx + block[7] * fy + block[8] * fz
        out[a, 0] += x
        out[a, 1] += y
        out[a, 2] += z


def own_softness(residual: Residual) -> FloatArray:
    """Return how far a load moves its own node beyond the modes at most (n,), in m/N; 0 where nothing is kept."""
    place = np.zeros(residual.n_nodes, np.int64)
    _find_own_blocks(residual.store.address, place)
    softness, known = np.zeros(residual.n_nodes), place >= 0
    softness[known] = np.linalg.norm(residual.blocks[place[known]], axis=(1, 2))
    return softness


@kernel
def _find_own_blocks(address: Address[BlockStore], out: LongArray) -> None:
    """Write where each node's block with itself lies, -1 where there is none."""
    store = store_at(address)
    for node in range(out.shape[0]):
        out[node] = block_index(store, node, node)
