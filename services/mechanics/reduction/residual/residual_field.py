"""Residual displacement of the nodes round contact loads: the part of the wall's motion that the modes lack.

A load moves not only the nodes it acts on: the residual compliance fades over a few edges. Detection that moved the
loaded nodes alone would see spikes, and contacts would jump from one triangle to the next.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from services.mechanics.arrays import Float32Array, FloatArray, IntArray, LongArray
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address, Struct, reader
from services.mechanics.reduction.reduced_duct import ReducedDuct
from services.mechanics.reduction.residual.blocks import BlockArray, BlockStore, block_between, block_index
from services.mechanics.reduction.residual.node_numbering import forget_numbers, number_node
from services.mechanics.surface.mesh import TriangleMesh, vertex_adjacency

# So many edges away from a load the wall is moved by it.
RINGS = 3
# A load that dents its own node by more than this moves what is so many edges away: the residual falls off slowly, to a
# tenth of that at three edges and a thirtieth at six, and jaws press on dozens of nodes.
DENT_M, DENT_RINGS = 0.2e-3, 6
# Walls thinner than this are within the error that this leaves of where they are: a sixtieth of all dents together
# where jaws press, and all of them beside that. Each load moves them as far as there is room for.
THIN_M = 0.2e-3
THIN_RINGS, MOST_BLOCKS = 16, 1_800_000


class FieldArrays(Struct):
    """Blocks of the residual near each of n nodes, in the order of its ring, and what loads move."""

    blocks: Annotated[Float32Array, "b", 3, 3]
    place: Annotated[LongArray, "k"]  # of the block of each entry of the ring, -1 where there is none
    start: Annotated[IntArray, "n + 1"]
    near: Annotated[IntArray, "n"]  # where the part of each ring ends that every load moves; a deep dent moves all
    softness: Annotated[FloatArray, "n"]  # how far a load moves its own node at most, in m/N
    ring: Annotated[IntArray, "k"]
    slot: Annotated[IntArray, "n"]  # scratch, all -1
    node: Annotated[IntArray, "n"]
    displacement: Annotated[FloatArray, "n", 3]
    dent_m: float  # what a load moves its own node by if its dent is deep


field_at = reader(FieldArrays)


class ResidualField:
    """Residual displacement on the loaded nodes and those up to `RINGS`, or `DENT_RINGS`, edges away from each load.

    Of thin walls up to `THIN_RINGS`, or as many as there is room for.

    It keeps a copy of the blocks near each node in the order in which they are read: out of the whole residual every
    one would come from another page.

    Attributes
    ----------
    nodes : (N,) int32, displacement_m : (N, 3) float64
        The first ``count`` mean something, each node once.
    """

    def __init__(self, duct: ReducedDuct, thickness_m: float) -> None:
        n = duct.mesh.n_vertices
        near, start, ring = (_all_of_thin if thickness_m < THIN_M else _near_first)(duct.mesh)
        place = np.zeros(len(ring), np.int64)
        find_places(duct.residual.store, (start, ring), place)
        known = place >= 0
        place[known] = np.arange(known.sum())
        blocks = np.empty((int(known.sum()), 3, 3), np.float32)
        copy_blocks(duct.residual.store, (start, ring), place, blocks)
        for constant in (near, start, ring, place, blocks):  # 40 MB, which a simulation's beginning need not hold twice
            constant.flags.writeable = False
        self.nodes = np.zeros(n, np.int32)
        self.displacement_m = np.zeros((n, 3))
        self.count = 0
        self._arrays = FieldArrays(
            blocks=blocks,
            place=place,
            start=start,
            near=near,
            softness=own_softness(duct),
            dent_m=DENT_M,
            ring=ring,
            slot=np.full(n, -1, np.int32),
            node=self.nodes,
            displacement=self.displacement_m,
        )
        self.address = self._arrays.address

    def update(self, load_nodes: IntArray, load_force_n: FloatArray) -> None:
        """Take the loads (l,), (l, 3) of a tick along undeformed axes, each node once."""
        self.count = displace_round_loads(self.address, load_nodes, load_force_n)


def own_softness(duct: ReducedDuct) -> FloatArray:
    """Return how far a load moves its own node beyond the modes at most (n,), in m/N; 0 where nothing is kept."""
    n = duct.mesh.n_vertices
    place = np.zeros(n, np.int64)
    find_places(duct.residual.store, (np.arange(n + 1, dtype=np.int32), np.arange(n, dtype=np.int32)), place)
    softness, known = np.zeros(n), place >= 0
    softness[known] = np.linalg.norm(duct.residual.blocks[place[known]], axis=(1, 2))
    return softness


def neighbourhoods(mesh: TriangleMesh, rings: int) -> tuple[IntArray, IntArray]:
    """Return (n + 1,) starts and the nodes within ``rings`` edges of each node, itself included."""
    step = vertex_adjacency(mesh).astype(np.float64)
    step.setdiag(1.0)
    reach = step
    for _ in range(rings - 1):
        reach = (reach @ step).tocsr()
    reach.sort_indices()
    return reach.indptr.astype(np.int32), reach.indices.astype(np.int32)


def _near_first(mesh: TriangleMesh) -> tuple[IntArray, IntArray, IntArray]:
    """Return where the near part of each neighbourhood ends, where each begins, and them, what is near first."""
    near, far = neighbourhoods(mesh, RINGS), neighbourhoods(mesh, DENT_RINGS)
    put_first(near, far)
    return far[0][:-1] + np.diff(near[0]), *far


def _all_of_thin(mesh: TriangleMesh) -> tuple[IntArray, IntArray, IntArray]:
    """Return the same of a thin wall: every load moves all."""
    start, ring = neighbourhoods(mesh, _rings_of_thin(mesh.n_vertices))
    return start[1:].copy(), start, ring


def _rings_of_thin(n_nodes: int) -> int:
    """Return so many edges away from a load a thin wall of so many nodes is moved by it, as there is room for."""
    rings = THIN_RINGS
    while rings > DENT_RINGS and 3 * rings * (rings + 1) > MOST_BLOCKS // n_nodes:
        rings -= 1
    return rings


@kernel
def put_first(near: tuple[IntArray, IntArray], far: tuple[IntArray, IntArray]) -> None:
    """Put the nodes of near neighbourhoods first in the far ones that they are part of, in place; both ascend."""
    for node in range(near[0].shape[0] - 1):
        source, to = near[0][node + 1] - 1, far[0][node + 1] - 1
        for place in range(far[0][node + 1] - 1, far[0][node] - 1, -1):
            other = far[1][place]
            if source >= near[0][node] and near[1][source] == other:
                source -= 1
            else:
                far[1][to] = other
                to -= 1
        for place in range(near[0][node], near[0][node + 1]):
            far[1][far[0][node] + place - near[0][node]] = near[1][place]


@kernel
def find_places(residual: BlockStore, neighbourhood: tuple[IntArray, IntArray], out: LongArray) -> None:
    """Write where the block of each node and each of its neighbourhood lies, -1 where there is none."""
    start, ring = neighbourhood
    for node in range(start.shape[0] - 1):
        for k in range(start[node], start[node + 1]):
            out[k] = block_index(residual, node, ring[k])


@kernel
def copy_blocks(
    residual: BlockStore, neighbourhood: tuple[IntArray, IntArray], place: LongArray, out: BlockArray
) -> None:
    """Write the block of each node and each of its neighbourhood into its place, those that there are."""
    start, ring = neighbourhood
    for node in range(start.shape[0] - 1):
        for k in range(start[node], start[node + 1]):
            if place[k] >= 0:
                block = block_between(residual, node, ring[k])
                for i in range(3):
                    for j in range(3):
                        out[place[k], i, j] = block[3 * i + j]


@kernel
def displace_round_loads(address: Address[FieldArrays], load_nodes: IntArray, load_force: FloatArray) -> int:
    """Write nodes and residual displacements and return how many."""
    field = field_at(address)
    slot, nodes, u, ring = field.slot, field.node, field.displacement, field.ring
    count = 0
    for load in range(load_nodes.shape[0]):
        source = load_nodes[load]
        x, y, z = load_force[load, 0], load_force[load, 1], load_force[load, 2]
        if x == 0.0 and y == 0.0 and z == 0.0:
            continue
        is_deep = field.softness[source] ** 2 * (x * x + y * y + z * z) > field.dent_m * field.dent_m
        end = field.start[source + 1] if is_deep else field.near[source]
        for k in range(field.start[source], end):
            number = number_node(ring[k], slot, nodes, count)
            if number == count:
                u[count, 0] = u[count, 1] = u[count, 2] = 0.0
                count += 1
            _displace(field, k, number, (x, y, z))
    forget_numbers(slot, nodes, count)
    return count


@kernel
def _displace(field: FieldArrays, k: int, number: int, force: tuple[float, float, float]) -> None:
    """Add to a displacement what a force does by the block of the k-th entry of the rings."""
    place, blocks, u = field.place[k], field.blocks, field.displacement
    if place >= 0:
        for i in range(3):
            # R is symmetric: the row of the load holds the transposed block.
            u[number, i] += (
                blocks[place, 0, i] * force[0] + blocks[place, 1, i] * force[1] + blocks[place, 2, i] * force[2]
            )
