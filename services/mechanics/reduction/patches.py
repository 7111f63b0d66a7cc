"""Residual compliance kept as patches, for meshes whose full block would not fit in memory.

The response left to R is local once the modes carry the far field, so each node keeps R only to the nodes
within a radius. docs/decisions/residual-patches.md says what a radius costs in error.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from services.mechanics.fem import ShellModel
from services.mechanics.reduction.basis import ModalBasis
from services.mechanics.reduction.build import BATCH, Progress, ignore_progress, residual_response
from services.mechanics.reduction.residual import BlockArray, Residual
from services.mechanics.reduction.state import FloatArray, IntArray

EXACT_NODES = 12_000
"""Up to here every node is loaded on its own: a few minutes; beyond it nodes share solves."""
PAIR_BYTES = 40
"""One float32 block and one index."""


def build_patches(
    model: ShellModel,
    basis: ModalBasis,
    radius_m: float,
    probing: bool | None = None,
    progress: Progress = ignore_progress,
) -> Residual:
    """Compute the patches, node by node or by probing.

    Probing loads nodes two radii apart in one solve. Their patches do not meet, so the number of solves is set
    by how many nodes lie within two radii, not by the size of the mesh; what the far residual of one node
    spills into the patch of another is of the size of what the cut drops (Tang and Saad 2012, probing for the
    diagonal of an inverse).

    Parameters
    ----------
    model, basis
        Full duct and its modes.
    radius_m : float
        Blocks are kept between nodes at most this far apart.
    probing : bool, optional
        By default above `EXACT_NODES` nodes.
    progress : callable
        Called as ``progress(stage, fraction)``.
    """
    vertices = model.mesh.vertices_m
    starts, neighbours = patch_pattern(vertices, radius_m)
    blocks = np.zeros((neighbours.size, 3, 3), np.float32)
    if probing is None:
        probing = len(vertices) > EXACT_NODES
    colours = colour_apart(vertices, 2.0 * radius_m) if probing else np.arange(len(vertices), dtype=np.int32)
    n_colours = int(colours.max()) + 1
    for first in range(0, n_colours, BATCH):
        in_batch = colours - np.int32(first)
        loaded = np.flatnonzero((in_batch >= 0) & (in_batch < BATCH)).astype(np.int32)
        response = residual_response(model, basis, loaded, in_batch[loaded])
        _read_patches(starts, neighbours, in_batch, response, blocks)
        progress("residual compliance", min(first + BATCH, n_colours) / n_colours)
    return Residual.patches(starts, neighbours, _symmetrised(starts, neighbours, blocks))


def patch_pattern(vertices_m: FloatArray, radius_m: float) -> tuple[IntArray, IntArray]:
    """Return row starts (n + 1,) and neighbours (p,), ascending, of all pairs of vertices within ``radius_m``."""
    n = len(vertices_m)
    pairs = cKDTree(vertices_m).query_pairs(radius_m, output_type="ndarray")
    itself = np.arange(n)
    rows = np.concatenate([pairs[:, 0], pairs[:, 1], itself])
    columns = np.concatenate([pairs[:, 1], pairs[:, 0], itself])
    order = np.lexsort((columns, rows))
    starts = np.searchsorted(rows[order], np.arange(n + 1))
    return starts.astype(np.int32), columns[order].astype(np.int32)


def largest_radius_m(vertices_m: FloatArray, budget_bytes: int) -> float:
    """Return the largest patch radius in m, to 1 %, whose blocks fit ``budget_bytes``.

    Raises
    ------
    ValueError
        Not even a block a node fits.
    """
    tree, most_pairs = cKDTree(vertices_m), budget_bytes // PAIR_BYTES
    if most_pairs < len(vertices_m):
        raise ValueError(f"a residual of {len(vertices_m)} nodes does not fit {budget_bytes} bytes")
    low, high = 0.0, float(np.linalg.norm(np.ptp(vertices_m, axis=0)))
    while high - low > 0.01 * high:
        middle = 0.5 * (low + high)
        fits = tree.count_neighbors(tree, middle) <= most_pairs
        low, high = (middle, high) if fits else (low, middle)
    return low


def colour_apart(vertices_m: FloatArray, distance_m: float) -> IntArray:
    """Return a colour (n,) for each vertex; vertices of one colour are more than ``distance_m`` apart."""
    colours: IntArray = _greedy_colours(*patch_pattern(vertices_m, distance_m))
    return colours


@njit(cache=True)
def _greedy_colours(starts: IntArray, neighbours: IntArray) -> IntArray:
    n = starts.shape[0] - 1
    colours = np.full(n, -1, np.int32)
    taken_for = np.full(n, -1, np.int32)
    for node in range(n):
        for k in range(starts[node], starts[node + 1]):
            if colours[neighbours[k]] >= 0:
                taken_for[colours[neighbours[k]]] = node
        colour = 0
        while taken_for[colour] == node:
            colour += 1
        colours[node] = colour
    return colours


@njit(cache=True)
def _read_patches(
    starts: IntArray, neighbours: IntArray, columns: IntArray, response: FloatArray, blocks: BlockArray
) -> None:
    """Copy from ``response`` (n, c, 3, 3) the blocks whose second node was loaded in one of its columns."""
    for node in range(starts.shape[0] - 1):
        for k in range(starts[node], starts[node + 1]):
            column = columns[neighbours[k]]
            if 0 <= column < response.shape[1]:
                blocks[k] = response[node, column]


def _symmetrised(starts: IntArray, neighbours: IntArray, blocks: BlockArray) -> BlockArray:
    """Return the mean of each block and the transpose of its mirror image; probing leaves them a little apart."""
    n = starts.size - 1
    places = csr_array((np.arange(neighbours.size), neighbours, starts), shape=(n, n))
    mirror = places.T.tocsr().data
    return 0.5 * (blocks + blocks[mirror].transpose(0, 2, 1))
