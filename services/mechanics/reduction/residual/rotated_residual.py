"""The residual compliance of a duct whose cross-sections are turned.

R belongs to the wall: between two nodes it acts along world axes as Q_a R_ab Q_b^T, with the rotations Q of their
sections. It stays symmetric and as positive as R itself, which is what contacts rely on.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Address
from trocar.services.mechanics.reduction.coincident_points import is_copied
from trocar.services.mechanics.reduction.large_rotations.warping import SectionFrame
from trocar.services.mechanics.reduction.residual.blocks import (
    Block,
    BlockStore,
    Residual,
    apply,
    block_between,
    store_at,
)


@dataclass(frozen=True, slots=True)
class RotatedResidual(Residual):
    """R along world axes, in the state that ``frame`` was last updated to; a step allocates nothing here.

    Attributes:
        corner_rotation: (3 c, 3, 3) float64. Scratch of `gather_points` at up to c points.
        load_n: (6 c, 3) float64. Scratch of `apply`: loads along undeformed axes.
    """

    frame: SectionFrame
    corner_rotation: FloatArray = field(repr=False)
    load_n: FloatArray = field(repr=False)

    @classmethod
    def of(cls, residual: Residual, frame: SectionFrame, n_points: int) -> RotatedResidual:
        """Turn ``residual`` with ``frame``: for up to ``n_points`` contact points, and twice the loads they make."""
        rooms = np.zeros((3 * n_points, 3, 3)), np.zeros((6 * n_points, 3))
        return cls(residual.store, frame, *rooms)

    def gather_points(self, nodes: IntArray, weights: FloatArray, out: FloatArray, source: IntArray) -> None:
        """Write R between points of triangles into ``out`` (3 k, 3 k); ``nodes`` and ``weights`` are (k, 3).

        Blocks that ``source`` (k,) says are copies are left out, see `coincident_points`.
        """
        rotations = self.corner_rotation[: nodes.size]
        self.frame.node_rotations(nodes.reshape(-1), rotations)
        gather_turned_points(self.store.address, (nodes, weights), rotations, out, source)

    def apply(self, load_nodes: IntArray, load_forces: FloatArray, nodes: IntArray, out: FloatArray) -> None:
        """Add to ``out`` (k, 3), in m, what ``load_forces`` (l, 3) in N on ``load_nodes`` (l,) do to ``nodes``.

        What ``out`` holds goes into the undeformed axes and back: two roundings in the place of memory.
        """
        loads = self.load_n[: len(load_nodes)]
        self.frame.turn_back(load_nodes, load_forces, loads)
        self.frame.turn_back(nodes, out, out)
        apply(self.store.address, load_nodes, loads, nodes, out)
        self.frame.turn_vectors(nodes, out, out)


@kernel
def gather_turned_points(
    address: Address[BlockStore],
    points: tuple[IntArray, FloatArray],
    rotations: FloatArray,
    out: FloatArray,
    source: IntArray,
) -> None:
    """Weigh the turned blocks between the corners of points, (nodes (k, 3), weights (k, 3)), into ``out`` (3 k, 3 k).

    ``rotations`` (3 k, 3, 3) are those of the corners.
    """
    store, (nodes, weights) = store_at(address), points
    for a in range(nodes.shape[0]):
        for b in range(a + 1):
            if is_copied(source, a, b):
                continue
            for i in range(3):
                for j in range(3):
                    out[3 * a + i, 3 * b + j] = 0.0
            for corner in range(9):
                p, r = 3 * a + corner // 3, 3 * b + corner % 3
                weight = weights[a, corner // 3] * weights[b, corner % 3]
                if weight != 0.0:
                    block = block_between(store, nodes[a, corner // 3], nodes[b, corner % 3])
                    _add_turned(weight, block, rotations, p, r, out[3 * a :, 3 * b :])
            for i in range(3):
                for j in range(3):
                    out[3 * b + j, 3 * a + i] = out[3 * a + i, 3 * b + j]


@kernel
def _add_turned(weight: float, block: Block, rotations: FloatArray, p: int, r: int, out: FloatArray) -> None:
    """Add ``weight`` Q_p block Q_r^T to the first block of ``out``."""
    for j in range(3):
        x, y, z = weight * rotations[r, j, 0], weight * rotations[r, j, 1], weight * rotations[r, j, 2]
        u = block[0] * x + block[1] * y + block[2] * z
        v = block[3] * x + block[4] * y + block[5] * z
        w = block[6] * x + block[7] * y + block[8] * z
        for i in range(3):
            out[i, j] += rotations[p, i, 0] * u + rotations[p, i, 1] * v + rotations[p, i, 2] * w
