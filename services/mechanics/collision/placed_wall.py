"""Positions of the wall's nodes from all modes and all loads, at the start or at the end of a step.

Detection, contact rows, pricing and picture use the same wall, because all of them compute it from the same coordinates
and loads. The cost per node is proportional to the number of modes and loads: 150 nodes, 80 modes and 30 loads need
50,000 products. So a *configuration* (coordinates and loads) is set first, which bounds the motion of every node, and
then only requested nodes are computed.

The bound: beyond the modes, loads f move node i by sum_l R_il f_l, with R the residual compliance, and |R_il| is at
most sqrt(|R_ii| |R_ll|), because R is symmetric and positive semidefinite (Cauchy-Schwarz). For the modes see
`wall_bounds`.
"""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from services.mechanics.arrays import AnyArray, ByteArray, Float32Array, FloatArray, IntArray, LongArray
from services.mechanics.collision.wall_bounds import Blocks, RotatingBounds, WallBounds, moved_by_blocks, wall_bounds
from services.mechanics.compiled import inlined_kernel, kernel, summing_kernel
from services.mechanics.compiled.struct import Address, Struct, reader
from services.mechanics.compiled.vectors import along, dot, put_row, row
from services.mechanics.reduction.large_rotations.warping import SectionFrame
from services.mechanics.reduction.reduced_duct import ReducedDuct
from services.mechanics.reduction.residual.blocks import BlockStore, block_between, own_softness, store_at

#: Maximum size of the cache of residual blocks (65 MB), and of cached rows, one for each loaded node.
MAX_BLOCKS, MAX_ROWS = 1_800_000, 128
Loads = tuple[IntArray, FloatArray]
"""Nodes (l,) and forces (l, 3) in N, along world axes."""
NO_LOADS: Loads = (np.zeros(0, np.int32), np.zeros((0, 3)))


class PlacedWall(Struct):
    """A wall of n nodes and r modes, its configuration, and the positions of the nodes that were placed; SI units."""

    rest: Annotated[FloatArray, "n", 3]
    Phi: Annotated[FloatArray, "n", 3, "r"]
    blocks: Annotated[Float32Array, "b", 3, 3]  # cached rows of the residual compliance
    known: Annotated[ByteArray, "b"]  # one if a block of a cached row has been read
    row_of: Annotated[IntArray, "n"]  # the cached row of each node, -1 if there is none
    kept: Annotated[IntArray, "k"]  # the node of each cached row, -1 if the row is free
    next_row: Annotated[IntArray, 1]  # that is replaced next
    softness: Annotated[FloatArray, "n"]  # square root of |R_ii|
    change: Annotated[FloatArray, "n", 3]  # of the loads on each node; zero between uses
    changed: Annotated[IntArray, "c"]  # nodes whose loads change
    requested: Annotated[IntArray, "n"]  # nodes requested in this configuration
    extra: Annotated[FloatArray, "n", 3]  # their displacement beyond the modes
    position: Annotated[FloatArray, "n", 3]
    placed: Annotated[LongArray, "n"]  # number of the configuration in which each node was placed last
    q: Annotated[FloatArray, "r"]
    load_node: Annotated[IntArray, "l"]
    load_force: Annotated[FloatArray, "l", 3]
    n_loads: int = 0
    n_changed: int = 0
    n_requested: int = 0
    n_placed: int = 0  # of the requested ones
    configuration: int = 1  # number of the present configuration, increased by every change
    softest: float = 0.0  # largest entry of ``softness``


wall_at = reader(PlacedWall)
_RESIDUAL = "blocks", "known", "row_of", "kept", "next_row", "softness"


class WallPlacement:
    """Places nodes of a wall with linear kinematics.

    Args:
        duct: ReducedDuct. The wall.
        like: WallPlacement or None. Another placement of the same wall, whose residual and bounds are shared. The new
            one may then only `follow` it.

    Attributes:
        bounds: WallBounds. Bounds of the modes' motion from the present configuration.
        position_m: (n, 3) float64. Positions of the nodes; of nodes not yet placed, those in an earlier configuration.
    """

    def __init__(self, duct: ReducedDuct, like: WallPlacement | None = None) -> None:
        n = duct.mesh.n_vertices
        rest, Phi = np.ascontiguousarray(duct.mesh.vertices_m), np.ascontiguousarray(duct.basis.Phi)
        shared = _residual(duct) if like is None else {name: getattr(like.wall, name) for name in _RESIDUAL}
        extents = {"n": n, "r": Phi.shape[2], "l": 2 * n, "c": 4 * n}
        self.wall: PlacedWall = PlacedWall.zeros(rest=rest, Phi=Phi, position=rest.copy(), **extents, **shared)
        self.wall.softest = float(self.wall.softness.max(initial=0.0))
        self._store = duct.residual.store
        self.bounds: WallBounds = wall_bounds(duct) if like is None else like.bounds
        self.position_m = self.wall.position
        self.every = np.arange(n, dtype=np.int32)

    def set_configuration(self, q: FloatArray, loads: Loads, lasting: Loads = NO_LOADS) -> float:
        """Set the wall's coordinates q (r,) and loads; return a bound, in m, on the motion of any node.

        ``lasting`` are loads other than those of contacts. If nothing moves, placed nodes remain valid.
        """
        return float(configure_wall(self.wall.address, (q, self.bounds.blocks), 0.0, loads, lasting))

    def place(self, nodes: IntArray) -> None:
        """Compute the positions of ``nodes`` (k,) in this configuration, unless they are known already."""
        request_nodes(self.wall.address, nodes)
        self.place_requested()

    def place_requested(self) -> None:
        """Compute the positions of the requested nodes."""
        place_requested(self.wall.address, self._store.address)

    def follow(self, other: WallPlacement) -> None:
        """Copy the configuration of another placement of this wall, and the positions of its placed nodes."""
        copy_configuration(self.wall.address, other.wall.address)


class RotatingPlacement(WallPlacement):
    """Places nodes of a wall whose sections rotate: loads are rotated back to the rest frame of the residual."""

    bounds: RotatingBounds

    def __init__(self, duct: ReducedDuct, like: WallPlacement | None = None) -> None:
        super().__init__(duct, like)
        if duct.warp is None:
            raise ValueError("a wall that turns needs a duct with a warp")
        self._frame = SectionFrame(duct.warp)
        n = duct.mesh.n_vertices
        self._force_n, self._at_m, self._extra_m = np.zeros((2 * n, 3)), np.zeros((n, 3)), np.zeros((n, 3))

    def set_configuration(self, q: FloatArray, loads: Loads, lasting: Loads = NO_LOADS) -> float:
        """Set the wall's coordinates and loads, see `WallPlacement.set_configuration`."""
        rotated_m = self.bounds.rotated_m(q, float(reach_of_loads(self.wall.address)))
        self.bounds.set_reference(q)
        self._frame.update(q)
        rotated = self._rotated_back(loads, 0), self._rotated_back(lasting, len(loads[0]))
        return float(configure_wall(self.wall.address, (q, self.bounds.blocks), rotated_m, *rotated))

    def place_requested(self) -> None:
        """Compute the positions of the requested nodes, see `WallPlacement.place_requested`."""
        wall = self.wall
        if not displace(wall.address, self._store.address):
            return
        nodes = wall.requested[wall.n_placed : wall.n_requested]
        count, wall.n_placed = len(nodes), wall.n_requested
        np.take(wall.extra, nodes, axis=0, out=self._extra_m[:count])
        self._frame.node_positions(nodes, self._extra_m[:count], self._at_m[:count])
        self.position_m[nodes] = self._at_m[:count]

    def follow(self, other: WallPlacement) -> None:
        """Copy the configuration of another placement, see `WallPlacement.follow`."""
        super().follow(other)
        self._frame.update(self.wall.q)

    def _rotated_back(self, loads: Loads, first: int) -> Loads:
        force_n = self._force_n[first : first + len(loads[0])]
        self._frame.turn_back(loads[0], loads[1], force_n)
        return loads[0], force_n


def place_walls(duct: ReducedDuct, like: WallPlacement | None = None) -> WallPlacement:
    """Return the placement that fits this duct, see `WallPlacement`."""
    return (WallPlacement if duct.warp is None else RotatingPlacement)(duct, like)


def _residual(duct: ReducedDuct) -> dict[str, AnyArray]:
    """Return a cache of the residual's rows: empty, or all rows if the residual is stored in full."""
    residual, n = duct.residual, duct.mesh.n_vertices
    is_whole = len(residual.blocks) == n * n and residual.blocks.dtype == np.float32
    k = n if is_whole else max(min(MAX_ROWS, MAX_BLOCKS // n), 1)
    nodes, none = np.arange(n, dtype=np.int32), np.int32(-1)
    return {
        "kept": nodes.copy() if is_whole else np.full(k, none),
        "row_of": nodes if is_whole else np.full(n, none),
        "next_row": np.zeros(1, np.int32),
        "known": np.full(k * n, is_whole, np.int8),
        "blocks": residual.blocks if is_whole else np.zeros((k * n, 3, 3), np.float32),
        "softness": np.sqrt(own_softness(residual)),
    }


@kernel
def configure_wall(
    address: Address[PlacedWall], modes: tuple[FloatArray, Blocks], rotated_m: float, loads: Loads, lasting: Loads
) -> float:
    """Set coordinates and loads; return a bound (m) on any node's motion, of which ``rotated_m`` is by rotations.

    ``modes`` is (coordinates (r,), blocks of modes as for `moved_by_blocks`).
    """
    wall, q = wall_at(address), modes[0]
    moved_m = rotated_m + moved_by_blocks(modes[1], wall.q, q)
    for mode in range(q.shape[0]):
        wall.q[mode] = q[mode]
    wall.n_changed = 0
    for load in range(wall.n_loads):
        _note_change(wall, load, -1.0)
    wall.n_loads = 0
    _add_loads(wall, loads)
    _add_loads(wall, lasting)
    return float(_bound_motion(wall, moved_m))


@kernel
def _add_loads(wall: PlacedWall, loads: Loads) -> None:
    """Add loads to those of the configuration."""
    for load in range(loads[0].shape[0]):
        at = wall.n_loads
        wall.load_node[at] = loads[0][load]
        put_row(wall.load_force, at, row(loads[1], load))
        _note_change(wall, at, 1.0)
        wall.n_loads += 1


@kernel
def _note_change(wall: PlacedWall, load: int, sign: float) -> None:
    node = wall.load_node[load]
    wall.changed[wall.n_changed] = node
    wall.n_changed += 1
    put_row(wall.change, node, along(row(wall.change, node), row(wall.load_force, load), sign))


@inlined_kernel
def _bound_motion(wall: PlacedWall, moved_m: float) -> float:
    """Return a bound (m) on any node's motion, with ``moved_m`` that of the modes; motion makes all nodes stale."""
    total = 0.0
    for k in range(wall.n_changed):
        node = wall.changed[k]
        change = row(wall.change, node)
        wall.change[node] = 0.0
        total += wall.softness[node] * math.sqrt(dot(change, change))
    moved_m += wall.softest * total
    if moved_m != 0.0:
        wall.configuration += 1
        wall.n_requested = wall.n_placed = 0
    return float(moved_m)


@kernel
def reach_of_loads(address: Address[PlacedWall]) -> float:
    """Return a bound, in m, on the displacement of any node by the loads beyond the modes."""
    wall, total = wall_at(address), 0.0
    for load in range(wall.n_loads):
        force = row(wall.load_force, load)
        total += wall.softness[wall.load_node[load]] * math.sqrt(dot(force, force))
    return float(wall.softest * total)


@kernel
def request_nodes(address: Address[PlacedWall], nodes: IntArray) -> None:
    """Request ``nodes`` (k,)."""
    wall = wall_at(address)
    for k in range(nodes.shape[0]):
        request_node(wall, nodes[k])


@kernel
def request_node(wall: PlacedWall, node: int) -> None:
    """Request a node, unless it has been requested in this configuration."""
    if wall.placed[node] != wall.configuration:
        wall.placed[node], wall.requested[wall.n_requested] = wall.configuration, node
        wall.n_requested += 1


@kernel
def copy_configuration(address: Address[PlacedWall], other_address: Address[PlacedWall]) -> None:
    """Copy the configuration of another wall, and the positions of its placed nodes."""
    wall, other = wall_at(address), wall_at(other_address)
    wall.configuration, wall.n_loads, wall.n_requested, wall.n_placed = other.configuration, other.n_loads, 0, 0
    for mode in range(wall.q.shape[0]):
        wall.q[mode] = other.q[mode]
    for load in range(other.n_loads):
        wall.load_node[load] = other.load_node[load]
        put_row(wall.load_force, load, row(other.load_force, load))
    for k in range(other.n_placed):
        node = other.requested[k]
        wall.placed[node] = wall.configuration
        put_row(wall.position, node, row(other.position, node))


@kernel
def place_requested(address: Address[PlacedWall], store_address: Address[BlockStore]) -> None:
    """Place the requested nodes of a wall with linear kinematics."""
    if displace(address, store_address):
        place_displaced(address)


@kernel
def displace(address: Address[PlacedWall], store_address: Address[BlockStore]) -> bool:
    """Write the displacement beyond the modes of the nodes to be placed; return whether there are any.

    Blocks that are not cached are read from the store once.
    """
    wall, store = wall_at(address), store_at(store_address)
    n, first, end = wall.rest.shape[0], wall.n_placed, wall.n_requested
    for k in range(first, end):
        wall.extra[wall.requested[k]] = 0.0
    for load in range(wall.n_loads if end > first else 0):
        first_block = n * _row_of(wall, wall.load_node[load])
        _read_blocks(wall, store, wall.load_node[load], first_block)
        _displace(wall, first_block, load)
    return bool(end > first)


@inlined_kernel
def _displace(wall: PlacedWall, first: int, load: int) -> None:
    """Add a load's displacement of the nodes to be placed; ``first`` is the first block of the row of its node."""
    force, blocks, extra, requested = wall.load_force, wall.blocks, wall.extra, wall.requested
    x, y, z = force[load, 0], force[load, 1], force[load, 2]
    if x == 0.0 and y == 0.0 and z == 0.0:
        return
    for k in range(wall.n_placed, wall.n_requested):
        # R is symmetric: the row of the load holds the transposed block.
        node, b = requested[k], first + requested[k]
        extra[node, 0] += blocks[b, 0, 0] * x + blocks[b, 1, 0] * y + blocks[b, 2, 0] * z
        extra[node, 1] += blocks[b, 0, 1] * x + blocks[b, 1, 1] * y + blocks[b, 2, 1] * z
        extra[node, 2] += blocks[b, 0, 2] * x + blocks[b, 1, 2] * y + blocks[b, 2, 2] * z


@inlined_kernel
def _row_of(wall: PlacedWall, node: int) -> int:
    """Return the cached row of a node; if there is none, replace the oldest one."""
    place = wall.row_of[node]
    if place < 0:
        place = wall.next_row[0]
        wall.next_row[0] = (place + 1) % wall.kept.shape[0]
        if wall.kept[place] >= 0:
            wall.row_of[wall.kept[place]] = -1
        n = wall.rest.shape[0]
        wall.known[place * n : place * n + n] = 0
        wall.kept[place], wall.row_of[node] = node, place
    return int(place)


@inlined_kernel
def _read_blocks(wall: PlacedWall, store: BlockStore, source: int, first: int) -> None:
    """Read the missing blocks between node ``source``, whose row begins at ``first``, and the nodes to be placed."""
    for k in range(wall.n_placed, wall.n_requested):
        node = wall.requested[k]
        b = first + node
        if wall.known[b] == 0:
            wall.known[b] = 1
            block = block_between(store, source, node)
            for i in range(3):
                for j in range(3):
                    wall.blocks[b, i, j] = block[3 * i + j]


@summing_kernel
def place_displaced(address: Address[PlacedWall]) -> None:
    """Place the requested nodes at rest + Phi q + the displacement by loads beyond the modes."""
    wall = wall_at(address)
    rest, Phi, extra, position, q = wall.rest, wall.Phi, wall.extra, wall.position, wall.q
    for k in range(wall.n_placed, wall.n_requested):
        node = wall.requested[k]
        x, y, z = 0.0, 0.0, 0.0
        for mode in range(q.shape[0]):
            x += Phi[node, 0, mode] * q[mode]
            y += Phi[node, 1, mode] * q[mode]
            z += Phi[node, 2, mode] * q[mode]
        position[node, 0] = rest[node, 0] + extra[node, 0] + x
        position[node, 1] = rest[node, 1] + extra[node, 1] + y
        position[node, 2] = rest[node, 2] + extra[node, 2] + z
    wall.n_placed = wall.n_requested
