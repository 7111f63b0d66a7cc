"""The dent that contact loads leave in the wall beyond the modes, on the nodes round them.

A load moves not only the nodes it acts on: the residual compliance fades over a few edges. Detection that moved the
loaded nodes alone would see spikes, and contacts would jump from one triangle to the next.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from services.mechanics.kernel import kernel
from services.mechanics.mesh import TriangleMesh, vertex_adjacency
from services.mechanics.reduction.duct import ReducedDuct
from services.mechanics.reduction.residual import BlockArray, block_index

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int32]

RINGS = 3


class ResidualField:
    """Residual displacement on the loaded nodes and those up to `RINGS` edges away from each load.

    Attributes
    ----------
    nodes : (N,) int32, displacement_m : (N, 3) float64
        The first ``count`` mean something, each node once.
    """

    def __init__(self, duct: ReducedDuct) -> None:
        n = duct.mesh.n_vertices
        self._residual = duct.residual
        self._start, self._ring = neighbourhoods(duct.mesh, RINGS)
        self._slot = np.full(n, -1, np.int32)
        self.nodes = np.zeros(n, np.int32)
        self.displacement_m = np.zeros((n, 3))
        self.count = 0

    def update(self, load_nodes: IntArray, load_force_n: FloatArray) -> None:
        """Take the loads (l,), (l, 3) of a tick along undeformed axes, each node once."""
        r = self._residual
        self.count = displace_round_loads(
            (r.blocks, r.starts, r.neighbours, r.n_nodes),
            (self._start, self._ring),
            (load_nodes, load_force_n),
            self._slot,
            (self.nodes, self.displacement_m),
        )


def neighbourhoods(mesh: TriangleMesh, rings: int) -> tuple[IntArray, IntArray]:
    """Return (n + 1,) starts and the nodes within ``rings`` edges of each node, itself included."""
    step = vertex_adjacency(mesh).astype(np.float64)
    step.setdiag(1.0)
    reach = step
    for _ in range(rings - 1):
        reach = (reach @ step).tocsr()
    reach.sort_indices()
    return reach.indptr.astype(np.int32), reach.indices.astype(np.int32)


@kernel
def displace_round_loads(
    residual: tuple[BlockArray, IntArray, IntArray, int],
    neighbourhood: tuple[IntArray, IntArray],
    loads: tuple[IntArray, FloatArray],
    slot: IntArray,
    out: tuple[IntArray, FloatArray],
) -> int:
    """Write nodes and displacements of the dents and return how many; ``slot`` (n,) is scratch, all -1."""
    blocks, starts, neighbours, n_nodes = residual
    start, ring = neighbourhood
    nodes, u = out
    count = 0
    for load in range(loads[0].shape[0]):
        source, force = loads[0][load], loads[1][load]
        if force[0] == 0.0 and force[1] == 0.0 and force[2] == 0.0:
            continue
        for k in range(start[source], start[source + 1]):
            node = ring[k]
            if slot[node] < 0:
                slot[node] = count
                nodes[count] = node
                u[count, 0] = u[count, 1] = u[count, 2] = 0.0
                count += 1
            place = block_index(starts, neighbours, n_nodes, source, node)
            if place >= 0:
                block = blocks[place]
                for i in range(3):
                    # R is symmetric: the row of the load holds the transposed block.
                    u[slot[node], i] += block[0, i] * force[0] + block[1, i] * force[1] + block[2, i] * force[2]
    for index in range(count):
        slot[nodes[index]] = -1
    return count
