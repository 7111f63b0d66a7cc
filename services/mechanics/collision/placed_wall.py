"""Positions of the wall's nodes from all modes and all loads, at the start or at the end of a step.

Detection, contact rows, pricing and picture use the same wall, because all of them compute it from the same coordinates
and loads. The cost per node is proportional to the number of modes and loads: 150 nodes, 80 modes and 30 loads need
50,000 products. So a *configuration* (coordinates and loads) is set first, which bounds the motion of every node, and
then only requested nodes are computed.

The bound: beyond the modes, loads f move node i by sum_l R_il f_l, with R the residual compliance. That is at most
sqrt(|R_ii| f . R f), because R is symmetric and positive semidefinite (Cauchy-Schwarz). For small changes, for many
loads and where R is cut into patches the simpler sum of sqrt(|R_ll|) |f_l| takes the place of sqrt(f . R f), which it
bounds. For the modes see `wall_bounds`.
"""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from trocar.services.mechanics.arrays import AnyArray, ByteArray, Float32Array, FloatArray, IntArray, LongArray
from trocar.services.mechanics.collision.candidate_list import LOOK_AHEAD_M
from trocar.services.mechanics.collision.wall_bounds import (
    WallBounds,
    bound_between,
    bound_motion,
    copy_reference,
    set_reference,
    wall_bounds,
)
from trocar.services.mechanics.compiled import inlined_kernel, kernel, summing_kernel
from trocar.services.mechanics.compiled.struct import Struct
from trocar.services.mechanics.compiled.vectors import along, copy_rows, dot, put_row, row, row_of, squared_distance
from trocar.services.mechanics.reduction.large_rotations.warping_kernels import place_node, turn_vector
from trocar.services.mechanics.reduction.reduced_duct import ReducedDuct
from trocar.services.mechanics.reduction.residual.blocks import BlockStore, block_between
from trocar.services.mechanics.reduction.residual.cached_rows import MAX_ROWS, CachedRows

#: Up to here the simpler bound does: lists allow for ten times as much.
COARSE_M = 25e-6
#: Error of f . R f with blocks in single precision, relative to the square of the simpler sum.
FLOAT32_ERROR = 1e-6
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
    changed_by: Annotated[FloatArray, "c", 3]
    requested: Annotated[IntArray, "n"]  # nodes requested in this configuration
    extra: Annotated[FloatArray, "n", 3]  # their displacement beyond the modes
    position: Annotated[FloatArray, "n", 3]  # of nodes not placed in this configuration, that in an earlier one
    placed: Annotated[LongArray, "n"]  # number of the configuration in which each node was placed last
    bounds: WallBounds  # from this configuration, whose coordinates are its reference
    store: BlockStore
    load_node: Annotated[IntArray, "l"]
    load_force: Annotated[FloatArray, "l", 3]  # along the axes of the undeformed wall
    known_at: Annotated[FloatArray, "n", 3]  # where all nodes were when all were placed last, see `tightened_m`
    known_moved_m: float = math.inf  # bound on the motion of any node since then
    n_loads: int = 0
    n_changed: int = 0
    n_requested: int = 0
    n_placed: int = 0  # of the requested ones
    configuration: int = 1  # number of the present configuration, increased by every change
    softest: float = 0.0  # largest entry of ``softness``


_SHARED = "blocks", "known", "row_of", "kept", "next_row", "softness"


def place_wall(duct: ReducedDuct, like: PlacedWall | None = None) -> PlacedWall:
    """Return the undeformed wall of a duct.

    The cache of the residual is that of another wall of it, else the duct's own if it has one, else a new one.
    """
    n = duct.mesh.n_vertices
    rest, Phi = np.ascontiguousarray(duct.mesh.vertices_m), np.ascontiguousarray(duct.basis.Phi)
    shared = _rows(duct) if like is None else {name: getattr(like, name) for name in _SHARED}
    bounds = wall_bounds(duct, None if like is None else like.bounds)
    given = {"rest": rest, "Phi": Phi, "position": rest.copy(), "bounds": bounds, "store": duct.residual.store}
    wall: PlacedWall = PlacedWall.zeros(n=n, r=Phi.shape[2], l=2 * n, c=4 * n, **given, **shared)
    wall.softest = float(wall.softness.max(initial=0.0))
    return wall


def _rows(duct: ReducedDuct) -> dict[str, AnyArray]:
    return (duct.rows or CachedRows.of(duct.residual)).fields()


@kernel
def configure(wall: PlacedWall, q: FloatArray, loads: Loads, lasting: Loads) -> float:
    """Set the coordinates q (r,) and the loads, of which ``lasting`` are not of contacts.

    Return a bound, in m, on the motion of any node; if nothing moves, placed nodes remain valid.
    """
    moved_m = bound_motion(wall.bounds, q, _reach_of_loads(wall))
    set_reference(wall.bounds, q)
    _note_loads(wall, wall, -1.0)
    wall.n_loads = 0
    _add_loads(wall, loads)
    _add_loads(wall, lasting)
    _note_loads(wall, wall, 1.0)
    moved_m += _bound_by_loads(wall)
    if moved_m != 0.0:  # all nodes are stale
        wall.configuration += 1
        wall.n_requested = wall.n_placed = 0
    return float(moved_m)


@kernel
def tightened_m(wall: PlacedWall, moved_m: float) -> float:
    """Return how far any node has moved by a change of configuration that has this bound: exactly where it is useless.

    Loads that oppose each other on a soft wall have a bound of several times its radius where it moves by a tenth of a
    millimetre. Beyond what lists look ahead, all nodes are placed: that takes less than the triangles that such a
    bound calls for.
    """
    wall.known_moved_m += moved_m
    if moved_m <= LOOK_AHEAD_M:
        return moved_m
    place_all(wall)
    moved_m = min(moved_m, wall.known_moved_m - moved_m + _furthest_node(wall.position, wall.known_at))
    copy_rows(wall.position, wall.known_at, wall.position.shape[0])
    wall.known_moved_m = 0.0
    return float(moved_m)


@kernel
def place_all(wall: PlacedWall) -> None:
    """Place all nodes."""
    for node in range(wall.rest.shape[0]):
        request_node(wall, node)
    place_requested(wall)


@kernel
def _furthest_node(positions: FloatArray, others: FloatArray) -> float:
    """Return the largest distance (m) of a node (n, 3) from where it is in ``others``."""
    largest_2 = 0.0
    for node in range(positions.shape[0]):
        largest_2 = max(largest_2, squared_distance(row(positions, node), row(others, node)))
    return math.sqrt(largest_2)


@kernel
def bound_since(wall: PlacedWall, start: PlacedWall) -> float:
    """Return a bound, in m, on the motion of any node from the configuration of another wall of the duct."""
    _note_loads(wall, start, -1.0)
    _note_loads(wall, wall, 1.0)
    by_loads_m = _bound_by_loads(wall)
    moved_m = bound_between(wall.bounds, start.bounds, max(_reach_of_loads(wall), _reach_of_loads(start))) + by_loads_m
    if moved_m > LOOK_AHEAD_M:
        place_all(wall)
        place_all(start)
        moved_m = min(moved_m, _furthest_node(wall.position, start.position))
    return float(moved_m)


@kernel
def _add_loads(wall: PlacedWall, loads: Loads) -> None:
    """Add loads to those of the configuration."""
    for load in range(loads[0].shape[0]):
        at = wall.n_loads
        wall.load_node[at] = loads[0][load]
        if rotates(wall):
            turn_vector(wall.bounds.tube, loads[0][load], True, loads[1][load], wall.load_force[at])
        else:
            put_row(wall.load_force, at, row(loads[1], load))
        wall.n_loads += 1


@kernel
def rotates(wall: PlacedWall) -> bool:
    """Return whether the sections of a wall rotate."""
    return bool(wall.bounds.turn.shape[0] > 0)


@kernel
def _note_loads(wall: PlacedWall, of: PlacedWall, sign: float) -> None:
    """Add the loads of a configuration to the change of loads."""
    for load in range(of.n_loads):
        node = of.load_node[load]
        wall.changed[wall.n_changed] = node
        wall.n_changed += 1
        put_row(wall.change, node, along(row(wall.change, node), row(of.load_force, load), sign))


@kernel
def _bound_by_loads(wall: PlacedWall) -> float:
    """Return a bound (m) on any node's motion by the change of loads, beyond the modes, and clear the change."""
    n_nodes, total = 0, 0.0
    for k in range(wall.n_changed):
        node = wall.changed[k]
        change = row(wall.change, node)
        wall.change[node] = 0.0
        if change != (0.0, 0.0, 0.0):
            total += wall.softness[node] * math.sqrt(dot(change, change))
            wall.changed[n_nodes] = node
            put_row(wall.changed_by, n_nodes, change)
            n_nodes += 1
    wall.n_changed = 0
    is_definite = wall.store.starts.shape[0] == 0  # cut into patches it is not
    if is_definite and n_nodes <= MAX_ROWS // 2 and wall.softest * total > COARSE_M:
        total = math.sqrt(max(_energy_of_change(wall, n_nodes), 0.0) + FLOAT32_ERROR * total * total)
    return float(wall.softest * total)


@inlined_kernel
def _energy_of_change(wall: PlacedWall, n_nodes: int) -> float:
    """Return f . R f (J, twice the energy) of the change of loads f on the first nodes that are listed."""
    total, n, node, force = 0.0, wall.rest.shape[0], wall.changed, wall.changed_by
    for a in range(n_nodes):
        first = n * _row_of(wall, node[a])
        for b in range(a + 1):
            at = first + node[b]
            if wall.known[at] == 0:
                _read_block(wall, node[a], node[b], at)
            product = 0.0
            for i in range(3):
                product += force[a, i] * dot(row_of(wall.blocks, at, i), row(force, b))
            total += product if b == a else 2.0 * product
    return total


@inlined_kernel
def _reach_of_loads(wall: PlacedWall) -> float:
    """Return a bound, in m, on the displacement of any node by the loads beyond the modes."""
    total = 0.0
    for load in range(wall.n_loads):
        force = row(wall.load_force, load)
        total += wall.softness[wall.load_node[load]] * math.sqrt(dot(force, force))
    return float(wall.softest * total)


@kernel
def request_node(wall: PlacedWall, node: int) -> None:
    """Request a node, unless it has been requested in this configuration."""
    if wall.placed[node] != wall.configuration:
        wall.placed[node], wall.requested[wall.n_requested] = wall.configuration, node
        wall.n_requested += 1


@kernel
def copy_configuration(wall: PlacedWall, other: PlacedWall) -> None:
    """Copy the configuration of another wall of the same duct, and the positions of its placed nodes."""
    wall.configuration, wall.n_loads, wall.n_requested, wall.n_placed = other.configuration, other.n_loads, 0, 0
    copy_reference(other.bounds, wall.bounds)
    for load in range(other.n_loads):
        wall.load_node[load] = other.load_node[load]
        put_row(wall.load_force, load, row(other.load_force, load))
    for k in range(other.n_placed):
        node = other.requested[k]
        wall.placed[node] = wall.configuration
        put_row(wall.position, node, row(other.position, node))


@kernel
def place_requested(wall: PlacedWall) -> None:
    """Compute the positions of the requested nodes."""
    if wall.n_requested == wall.n_placed:
        return
    _displace_requested(wall)
    if rotates(wall):
        for k in range(wall.n_placed, wall.n_requested):
            node = wall.requested[k]
            place_node(wall.bounds.tube, node, wall.extra[node], wall.position[node])
    else:
        _place_displaced(wall)
    wall.n_placed = wall.n_requested


@inlined_kernel
def _displace_requested(wall: PlacedWall) -> None:
    """Write the displacement beyond the modes; blocks that are not cached are read from the store once."""
    blocks, extra, requested = wall.blocks, wall.extra, wall.requested
    for k in range(wall.n_placed, wall.n_requested):
        extra[requested[k]] = 0.0
    for load in range(wall.n_loads):
        first = wall.rest.shape[0] * _row_of(wall, wall.load_node[load])
        x, y, z = row(wall.load_force, load)
        if x == 0.0 and y == 0.0 and z == 0.0:
            continue
        for k in range(wall.n_placed, wall.n_requested):
            node, b = requested[k], first + requested[k]
            if wall.known[b] == 0:
                _read_block(wall, wall.load_node[load], node, b)
            # R is symmetric: the row of the load holds the transposed block.
            extra[node, 0] += blocks[b, 0, 0] * x + blocks[b, 1, 0] * y + blocks[b, 2, 0] * z
            extra[node, 1] += blocks[b, 0, 1] * x + blocks[b, 1, 1] * y + blocks[b, 2, 1] * z
            extra[node, 2] += blocks[b, 0, 2] * x + blocks[b, 1, 2] * y + blocks[b, 2, 2] * z


@kernel
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


@kernel
def _read_block(wall: PlacedWall, source: int, node: int, b: int) -> None:
    """Read the block between nodes ``source`` and ``node`` into the cache, at b."""
    block = block_between(wall.store, source, node)
    wall.known[b] = 1
    for i in range(3):
        for j in range(3):
            wall.blocks[b, i, j] = block[3 * i + j]


@summing_kernel
def _place_displaced(wall: PlacedWall) -> None:
    """Place the requested nodes at rest + Phi q + the displacement by loads beyond the modes."""
    rest, Phi, extra, position, q = wall.rest, wall.Phi, wall.extra, wall.position, wall.bounds.reference
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
