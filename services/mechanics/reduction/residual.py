"""Residual compliance: the static response of all the modes that were left out.

A truncated basis is too stiff exactly where a forceps pinches. The lost part of a static response,
R = K^-1 - Phi Lambda^-1 Phi^T, restores it: u_i = Phi_i q + sum_j R_ij f_j over the loaded nodes j. The modes
left out are faster than the tick, so their response is taken as immediate (static correction; Craig and
Kurdila, "Fundamentals of Structural Dynamics", mode acceleration method).
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
import numpy.typing as npt
from numba import njit

from services.mechanics.reduction.state import FloatArray, IntArray

BlockArray = npt.NDArray[np.float32] | npt.NDArray[np.float64]


class Residual(Protocol):
    """Reads 3 x 3 blocks of R, in m/N, for a few nodes; nothing is allocated and nothing depends on n."""

    def gather(self, nodes: IntArray, out: FloatArray) -> None:
        """Write R between ``nodes`` (k,) into ``out`` (3 k, 3 k)."""

    def gather_points(self, nodes: IntArray, weights: FloatArray, out: FloatArray) -> None:
        """Write R between points of triangles into ``out`` (3 k, 3 k).

        ``nodes`` (k, 3) are the corners, ``weights`` (k, 3) the barycentric coordinates of each point.
        """

    def apply(self, load_nodes: IntArray, load_forces: FloatArray, nodes: IntArray, out: FloatArray) -> None:
        """Add to ``out`` (k, 3), in m, what ``load_forces`` (l, 3) in N on ``load_nodes`` (l,) do to ``nodes``."""


class NoResidual:
    """The bare truncated basis, for comparison: every left-out mode is rigid."""

    def gather(self, nodes: IntArray, out: FloatArray) -> None:
        """Write zeros."""
        out[: 3 * len(nodes), : 3 * len(nodes)] = 0.0

    def gather_points(self, nodes: IntArray, weights: FloatArray, out: FloatArray) -> None:
        """Write zeros."""
        self.gather(nodes[:, 0], out)

    def apply(self, load_nodes: IntArray, load_forces: FloatArray, nodes: IntArray, out: FloatArray) -> None:
        """Add nothing."""


class FullResidual:
    """R between all nodes, one 3 x 3 block after the other.

    Parameters
    ----------
    blocks : (n, n, 3, 3) float32 or float64
        m/N; zero at fixed nodes. 36 n^2 bytes in float32, whose rounding is 1e-7 of each entry.
    """

    def __init__(self, blocks: BlockArray) -> None:
        if blocks.ndim != 4 or blocks.shape[0] != blocks.shape[1] or blocks.shape[2:] != (3, 3):
            raise ValueError(f"residual blocks have shape {blocks.shape}, expected (n, n, 3, 3)")
        self.blocks = blocks

    def gather(self, nodes: IntArray, out: FloatArray) -> None:
        """Write R between ``nodes`` (k,) into ``out`` (3 k, 3 k)."""
        gather_full(self.blocks, nodes, out)

    def gather_points(self, nodes: IntArray, weights: FloatArray, out: FloatArray) -> None:
        """Write R between points of triangles into ``out`` (3 k, 3 k)."""
        gather_points_full(self.blocks, nodes, weights, out)

    def apply(self, load_nodes: IntArray, load_forces: FloatArray, nodes: IntArray, out: FloatArray) -> None:
        """Add to ``out`` (k, 3), in m, what ``load_forces`` (l, 3) in N on ``load_nodes`` (l,) do to ``nodes``."""
        apply_full(self.blocks, load_nodes, load_forces, nodes, out)


@njit(cache=True, nogil=True, fastmath=False)
def gather_full(blocks: BlockArray, nodes: IntArray, out: FloatArray) -> None:
    """Copy the blocks between ``nodes`` (k,) into ``out`` (3 k, 3 k), using their symmetry."""
    for a in range(nodes.shape[0]):
        for b in range(a + 1):
            block = blocks[nodes[a], nodes[b]]
            for i in range(3):
                for j in range(3):
                    out[3 * a + i, 3 * b + j] = block[i, j]
                    out[3 * b + j, 3 * a + i] = block[i, j]


@njit(cache=True, nogil=True, fastmath=False)
def gather_points_full(blocks: BlockArray, nodes: IntArray, weights: FloatArray, out: FloatArray) -> None:
    """Weigh the blocks between the corners of points (k, 3) into ``out`` (3 k, 3 k)."""
    for a in range(nodes.shape[0]):
        for b in range(a + 1):
            _clear_block(out, a, b)
            for corner in range(3):
                for other in range(3):
                    weight = weights[a, corner] * weights[b, other]
                    if weight != 0.0:
                        _add_block(out, a, b, weight, blocks[nodes[a, corner], nodes[b, other]])
            _mirror_block(out, a, b)


@njit(cache=True, nogil=True, fastmath=False)
def apply_full(
    blocks: BlockArray, load_nodes: IntArray, load_forces: FloatArray, nodes: IntArray, out: FloatArray
) -> None:
    """Add R f of the loads (l, 3) to the displacements ``out`` (k, 3) of ``nodes``."""
    for a in range(nodes.shape[0]):
        for b in range(load_nodes.shape[0]):
            _add_product(out[a], blocks[nodes[a], load_nodes[b]], load_forces[b])


@njit(cache=True, nogil=True, fastmath=False)
def _clear_block(out: FloatArray, a: int, b: int) -> None:
    out[3 * a : 3 * a + 3, 3 * b : 3 * b + 3] = 0.0


@njit(cache=True, nogil=True, fastmath=False)
def _add_block(out: FloatArray, a: int, b: int, weight: float, block: FloatArray) -> None:
    for i in range(3):
        for j in range(3):
            out[3 * a + i, 3 * b + j] += weight * block[i, j]


@njit(cache=True, nogil=True, fastmath=False)
def _mirror_block(out: FloatArray, a: int, b: int) -> None:
    for i in range(3):
        for j in range(3):
            out[3 * b + j, 3 * a + i] = out[3 * a + i, 3 * b + j]


@njit(cache=True, nogil=True, fastmath=False)
def _add_product(out: FloatArray, block: FloatArray, force: FloatArray) -> None:
    for i in range(3):
        out[i] += block[i, 0] * force[0] + block[i, 1] * force[1] + block[i, 2] * force[2]
