"""Where nodes of the wall are: placed by all modes and all loads, at the start or at the end of a step.

Detection, contact rows, price and picture see the same wall, because all of them place it from the same coordinates and
loads. A node costs as many products as there are modes and loads: 150 nodes, 80 modes and 30 loads are 50,000.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from services.mechanics.arrays import AnyArray, ByteArray, Float32Array, FloatArray, IntArray, LongArray
from services.mechanics.compiled import kernel, summing_kernel
from services.mechanics.compiled.struct import Address, Struct, reader
from services.mechanics.reduction.large_rotations.warping import SectionFrame
from services.mechanics.reduction.reduced_duct import ReducedDuct
from services.mechanics.reduction.residual.blocks import BlockStore, block_between

#: Rows of the residual of loaded nodes that are kept: as many as there is room for in 65 MB, and no more than these.
MOST_BLOCKS, MOST_ROWS = 1_800_000, 128
Loads = tuple[IntArray, FloatArray]
"""Nodes (l,) and forces (l, 3) in N, along world axes."""
NO_LOADS: Loads = (np.zeros(0, np.int32), np.zeros((0, 3)))


class PlacedWall(Struct):
    """A wall of n nodes and r modes, and where those nodes are that were placed last."""

    rest: Annotated[FloatArray, "n", 3]
    Phi: Annotated[FloatArray, "n", 3, "r"]
    blocks: Annotated[Float32Array, "b", 3, 3]  # residual of all nodes, or of rows that are kept
    known: Annotated[ByteArray, "b"]  # one where a block of a row that is kept has been read
    row_of: Annotated[IntArray, "n"]  # which row of those that are kept is a node's, -1 where none is
    kept: Annotated[IntArray, "k"]  # the node of each row that is kept, -1 where it is free
    used: Annotated[LongArray, "k"]  # in which placement it was used last
    extra: Annotated[FloatArray, "n", 3]  # displacement beyond the modes, of the nodes that are being placed
    position: Annotated[FloatArray, "n", 3]
    q: Annotated[FloatArray, "r"]  # that nodes were placed by last, and loads, those that last beside contacts included
    load_node: Annotated[IntArray, "l"]
    load_force: Annotated[FloatArray, "l", 3]
    n_loads: int = 0
    placements: int = 0


wall_at = reader(PlacedWall)


class WallPlacement:
    """Places nodes of a straight wall.

    Parameters
    ----------
    duct : ReducedDuct

    Attributes
    ----------
    wall : PlacedWall
    position_m : (n, 3) float64
        Where the nodes are that were placed last; others are where they were.
    """

    def __init__(self, duct: ReducedDuct) -> None:
        n = duct.mesh.n_vertices
        rest, Phi = np.ascontiguousarray(duct.mesh.vertices_m), np.ascontiguousarray(duct.basis.Phi)
        extents = {"n": n, "r": Phi.shape[2], "l": 2 * n}
        self.wall = PlacedWall.zeros(rest=rest, Phi=Phi, position=rest.copy(), **extents, **_blocks(duct))
        self._store = duct.residual.store
        self.position_m = self.wall.position
        self.every = np.arange(n, dtype=np.int32)

    def place(self, nodes: IntArray, q: FloatArray, loads: Loads, lasting: Loads = NO_LOADS) -> float:
        """Place ``nodes`` (k,) by coordinates q (r,) and loads; return in m how far one of them has come.

        That is counted from where they were placed last. ``lasting`` are loads beside those of contacts.
        """
        self._displace(nodes, loads, lasting)
        moved_m: float = place_nodes(self.wall.address, nodes, q)
        return moved_m

    def is_placed_by(self, q: FloatArray, loads: Loads) -> bool:
        """Return whether nodes were placed last by just these coordinates and loads."""
        return bool(is_placed_by(self.wall.address, q, *loads))

    def _displace(self, nodes: IntArray, loads: Loads, lasting: Loads) -> None:
        self._add(nodes, loads, anew=True)
        if len(lasting[0]):
            self._add(nodes, lasting, anew=False)

    def _add(self, nodes: IntArray, loads: Loads, *, anew: bool) -> None:
        if len(self.wall.kept):
            displace_by_rows(self.wall.address, self._store, nodes, loads, anew)
        else:
            displace_nodes(self.wall.address, nodes, loads, anew)


class TurnedPlacement(WallPlacement):
    """Places nodes of a wall whose sections turn: loads are turned back, where the residual is known."""

    def __init__(self, duct: ReducedDuct) -> None:
        super().__init__(duct)
        if duct.warp is None:
            raise ValueError("a wall that turns needs a duct with a warp")
        self._frame = SectionFrame(duct.warp)
        n = duct.mesh.n_vertices
        self._force_n, self._at_m, self._extra_m = np.zeros((2 * n, 3)), np.zeros((n, 3)), np.zeros((n, 3))

    def place(self, nodes: IntArray, q: FloatArray, loads: Loads, lasting: Loads = NO_LOADS) -> float:
        """Place ``nodes`` (k,), see `WallPlacement.place`."""
        self._frame.update(q)
        self._displace(nodes, self._turned_back(loads, 0), self._turned_back(lasting, len(loads[0])))
        k = len(nodes)
        np.take(self.wall.extra, nodes, axis=0, out=self._extra_m[:k])
        self._frame.node_positions(nodes, self._extra_m[:k], self._at_m[:k])
        moved_m: float = put_nodes(self.wall.address, nodes, self._at_m)
        self.wall.q[:] = q
        return moved_m

    def is_placed_by(self, q: FloatArray, loads: Loads) -> bool:
        """Return False: loads are known as they were turned back."""
        return False

    def _turned_back(self, loads: Loads, first: int) -> Loads:
        force_n = self._force_n[first : first + len(loads[0])]
        self._frame.turn_back(loads[0], loads[1], force_n)
        return loads[0], force_n


def place_walls(duct: ReducedDuct) -> WallPlacement:
    """Return what places the nodes of this duct."""
    return WallPlacement(duct) if duct.warp is None else TurnedPlacement(duct)


def _blocks(duct: ReducedDuct) -> dict[str, AnyArray]:
    """Blocks of the residual as loads read them: all of it where it is stored so, or room for rows of loaded nodes."""
    residual, n = duct.residual, duct.mesh.n_vertices
    row_of: AnyArray = np.full(n, -1, np.int32)
    if len(residual.blocks) == n * n and residual.blocks.dtype == np.float32:
        none: dict[str, AnyArray] = {"kept": np.zeros(0, np.int32), "used": np.zeros(0, np.int64), "row_of": row_of}
        return none | {"blocks": residual.blocks, "known": np.zeros(n * n, np.int8)}
    k = max(min(MOST_ROWS, MOST_BLOCKS // n), 1)
    rows: dict[str, AnyArray] = {"kept": np.full(k, -1, np.int32), "used": np.zeros(k, np.int64), "row_of": row_of}
    return rows | {"blocks": np.zeros((k * n, 3, 3), np.float32), "known": np.zeros(k * n, np.int8)}


@kernel
def displace_nodes(address: Address[PlacedWall], nodes: IntArray, loads: Loads, anew: bool) -> None:
    """Add to the displacement of ``nodes`` beyond the modes, or begin it ``anew``, what loads do."""
    wall, n = wall_at(address), 0
    _begin(wall, nodes, loads, anew)
    n = wall.rest.shape[0]
    for load in range(loads[0].shape[0]):
        _displace(wall, nodes, loads[0][load] * n, loads[1][load])


@kernel
def displace_by_rows(
    address: Address[PlacedWall], store: BlockStore, nodes: IntArray, loads: Loads, anew: bool
) -> None:
    """Do as `displace_nodes`, where the residual is stored otherwise: blocks are read once, and kept."""
    wall = wall_at(address)
    _begin(wall, nodes, loads, anew)
    wall.placements += 1
    for load in range(loads[0].shape[0]):
        source = loads[0][load]
        row = _row_of(wall, source)
        _read_blocks(wall, store, (source, row), nodes)
        _displace(wall, nodes, row * wall.rest.shape[0], loads[1][load])


@kernel
def _begin(wall: PlacedWall, nodes: IntArray, loads: Loads, anew: bool) -> None:
    if anew:
        wall.n_loads = 0
        for k in range(nodes.shape[0]):
            for axis in range(3):
                wall.extra[nodes[k], axis] = 0.0
    _note_loads(wall, loads[0], loads[1])


@kernel
def _displace(wall: PlacedWall, nodes: IntArray, first: int, force: FloatArray) -> None:
    """Add what a force does to ``nodes``; ``first`` is where the row of its node begins."""
    x, y, z, blocks, extra = force[0], force[1], force[2], wall.blocks, wall.extra
    if x == 0.0 and y == 0.0 and z == 0.0:
        return
    for k in range(nodes.shape[0]):
        # R is symmetric: the row of the load holds the transposed block.
        node, b = nodes[k], first + nodes[k]
        extra[node, 0] += blocks[b, 0, 0] * x + blocks[b, 1, 0] * y + blocks[b, 2, 0] * z
        extra[node, 1] += blocks[b, 0, 1] * x + blocks[b, 1, 1] * y + blocks[b, 2, 1] * z
        extra[node, 2] += blocks[b, 0, 2] * x + blocks[b, 1, 2] * y + blocks[b, 2, 2] * z


@kernel
def _row_of(wall: PlacedWall, node: int) -> int:
    """Return the row that is kept of a node, in the place of the one used longest ago if there was none."""
    row = wall.row_of[node]
    if row < 0:
        row = 0
        for other in range(wall.kept.shape[0]):
            if wall.used[other] < wall.used[row]:
                row = other
        if wall.kept[row] >= 0:
            wall.row_of[wall.kept[row]] = -1
        n = wall.rest.shape[0]
        for b in range(row * n, row * n + n):
            wall.known[b] = 0
        wall.kept[row], wall.row_of[node] = node, row
    wall.used[row] = wall.placements
    return int(row)


@kernel
def _read_blocks(wall: PlacedWall, store: BlockStore, where: tuple[int, int], nodes: IntArray) -> None:
    """Read the blocks of a node, which has this row, with all of ``nodes`` that have not been read yet."""
    source, first = where[0], where[1] * wall.rest.shape[0]
    for k in range(nodes.shape[0]):
        b = first + nodes[k]
        if wall.known[b] == 0:
            wall.known[b] = 1
            block = block_between(store, source, nodes[k])
            for i in range(3):
                for j in range(3):
                    wall.blocks[b, i, j] = block[3 * i + j]


@kernel
def _note_loads(wall: PlacedWall, load_nodes: IntArray, forces: FloatArray) -> None:
    for load in range(load_nodes.shape[0]):
        wall.load_node[wall.n_loads] = load_nodes[load]
        for axis in range(3):
            wall.load_force[wall.n_loads, axis] = forces[load, axis]
        wall.n_loads += 1


@kernel
def is_placed_by(address: Address[PlacedWall], q: FloatArray, load_nodes: IntArray, forces: FloatArray) -> bool:
    """Return whether nodes were placed last by coordinates q (r,) and loads (l,), (l, 3)."""
    wall, n = wall_at(address), load_nodes.shape[0]
    if wall.n_loads != n:
        return False
    for mode in range(q.shape[0]):
        if wall.q[mode] != q[mode]:
            return False
    for load in range(n):
        if wall.load_node[load] != load_nodes[load]:
            return False
        for axis in range(3):
            if wall.load_force[load, axis] != forces[load, axis]:
                return False
    return True


@summing_kernel
def place_nodes(address: Address[PlacedWall], nodes: IntArray, q: FloatArray) -> float:
    """Place ``nodes`` at rest + Phi q + what loads do beyond it; return in m how far one of them has come."""
    wall, most_2 = wall_at(address), 0.0
    for mode in range(q.shape[0]):
        wall.q[mode] = q[mode]
    rest, Phi, extra, position = wall.rest, wall.Phi, wall.extra, wall.position
    for k in range(nodes.shape[0]):
        node = nodes[k]
        x, y, z = 0.0, 0.0, 0.0
        for mode in range(q.shape[0]):
            x += Phi[node, 0, mode] * q[mode]
            y += Phi[node, 1, mode] * q[mode]
            z += Phi[node, 2, mode] * q[mode]
        x += rest[node, 0] + extra[node, 0]
        y += rest[node, 1] + extra[node, 1]
        z += rest[node, 2] + extra[node, 2]
        u, v, w = x - position[node, 0], y - position[node, 1], z - position[node, 2]
        most_2 = max(most_2, u * u + v * v + w * w)
        position[node, 0], position[node, 1], position[node, 2] = x, y, z
    return float(np.sqrt(most_2))


@kernel
def put_nodes(address: Address[PlacedWall], nodes: IntArray, at: FloatArray) -> float:
    """Write where ``nodes`` (k,) are, (k, 3) in m; return in m how far one of them has come."""
    wall, most_2 = wall_at(address), 0.0
    for k in range(nodes.shape[0]):
        moved_2 = 0.0
        for axis in range(3):
            moved_2 += (at[k, axis] - wall.position[nodes[k], axis]) ** 2
            wall.position[nodes[k], axis] = at[k, axis]
        most_2 = max(most_2, moved_2)
    return float(np.sqrt(most_2))
