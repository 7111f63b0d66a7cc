"""Residual compliance kept as patches, for meshes whose full block would not fit in memory.

The response left to R is local once the modes carry the far field, so each node keeps R only to the nodes
within a radius. docs/decisions/residual-patches.md says what a radius costs in error.
"""

from __future__ import annotations

import math

import numpy as np
import scipy

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.compiled import building_kernel
from trocar.services.mechanics.fem import ShellModel
from trocar.services.mechanics.reduction.basis import ModalBasis
from trocar.services.mechanics.reduction.build import BATCH, Progress, ignore_progress, residual_response
from trocar.services.mechanics.reduction.residual.blocks import BlockArray, Residual
from trocar.services.mechanics.reduction.residual.level_inverse import compliance_rows
from trocar.services.mechanics.reduction.residual.selected_inverse import SelectedInverse

EXACT_NODES = 12_000
"""Up to here patches are exact; beyond it nodes share solves, the near field apart."""
MOST_COLOURS = 3_000
"""Solves a direction that probing may take, roughly."""
_CHUNK = 65_536
PAIR_BYTES = 9 * 4 + 4
"""Of memory that a pair takes: nine float32 of its block, and an index."""


def build_patches(
    model: ShellModel,
    basis: ModalBasis,
    radius_m: float,
    apart_m: float | None = None,
    progress: Progress = ignore_progress,
) -> Residual:
    """Compute the patches, exactly or by probing.

    They are read from the rows of K^-1, level of nodes by level (`level_inverse`), unless nodes share solves: probing.
    Probing loads distant nodes in one solve. Nodes at least two radii apart have patches that do not meet; what
    the far residual of one spills into the patch of another is then of the size of what the cut drops (probing
    for the diagonal of an inverse: Tang and Saad 2012). They are kept farther apart than that, as far as
    `MOST_COLOURS` solves a direction allow. What the factor's own pattern holds, a node with itself and with those
    it shares a triangle with among it, is then replaced by the exact blocks (`selected_inverse`).

    Args:
        model, basis: Full duct and its modes.
        radius_m: float. Blocks are kept between nodes at most this far apart.
        apart_m: float, optional. How far apart nodes that share a solve are; infinite for exact columns. By default
            exact up to `EXACT_NODES` nodes, and beyond as far as the number of solves allows.
        progress: callable. Called as ``progress(stage, fraction)``.
    """
    vertices = model.mesh.vertices_m
    starts, neighbours = patch_pattern(vertices, radius_m)
    blocks = np.zeros((neighbours.size, 3, 3), np.float32)
    distance_m = _default_distance_m(vertices, radius_m) if apart_m is None else apart_m
    if math.isinf(distance_m):
        _read_levels(model, basis, (starts, neighbours), blocks, progress)
        return Residual.patches(starts, neighbours, _symmetrised(starts, neighbours, blocks))
    colours = colour_apart(vertices, distance_m)
    n_colours = int(colours.max()) + 1
    for first in range(0, n_colours, BATCH):
        loaded = np.flatnonzero((colours >= first) & (colours < first + BATCH)).astype(np.int32)
        columns = colours[loaded] - np.int32(first)
        response = residual_response(model, basis, loaded, columns)
        _read_patches(starts, neighbours, loaded, columns, response, blocks)
        progress("residual compliance", min(first + BATCH, n_colours) / n_colours)
    symmetric = _symmetrised(starts, neighbours, blocks)
    progress("exact near field", 0.0)
    _make_near_exact(model, basis, starts, neighbours, symmetric)
    progress("exact near field", 1.0)
    return Residual.patches(starts, neighbours, symmetric)


def patch_pattern(vertices_m: FloatArray, radius_m: float) -> tuple[IntArray, IntArray]:
    """Return row starts (n + 1,) and neighbours (p,), ascending, of all pairs of vertices within ``radius_m``."""
    n = len(vertices_m)
    pairs = scipy.spatial.cKDTree(vertices_m).query_pairs(radius_m, output_type="ndarray")
    itself = np.arange(n)
    rows = np.concatenate([pairs[:, 0], pairs[:, 1], itself])
    columns = np.concatenate([pairs[:, 1], pairs[:, 0], itself])
    order = np.lexsort((columns, rows))
    starts = np.searchsorted(rows[order], np.arange(n + 1))
    return starts.astype(np.int32), columns[order].astype(np.int32)


def largest_radius_m(vertices_m: FloatArray, budget_bytes: int) -> float:
    """Return the largest patch radius in m, to 1 %, whose blocks fit ``budget_bytes``.

    Raises ValueError if not even a block a node fits.
    """
    most_pairs = budget_bytes // PAIR_BYTES
    if most_pairs < len(vertices_m):
        raise ValueError(f"a residual of {len(vertices_m)} nodes does not fit {budget_bytes} bytes")
    return _radius_of_pairs(vertices_m, most_pairs)


def _radius_of_pairs(vertices_m: FloatArray, most_pairs: int) -> float:
    """Return the largest distance within which there are at most ``most_pairs`` ordered pairs of vertices."""
    tree = scipy.spatial.cKDTree(vertices_m)
    low, high = 0.0, float(np.linalg.norm(np.ptp(vertices_m, axis=0)))
    while high - low > 0.01 * high:
        middle = 0.5 * (low + high)
        fits = tree.count_neighbors(tree, middle) <= most_pairs
        low, high = (middle, high) if fits else (low, middle)
    return low


def _default_distance_m(vertices_m: FloatArray, radius_m: float) -> float:
    """Return how far apart nodes that share a solve are kept.

    On a surface first fit needs about a third as many colours as a node has neighbours within the distance.
    """
    if len(vertices_m) <= EXACT_NODES:
        return math.inf
    return max(2.0 * radius_m, _radius_of_pairs(vertices_m, 3 * MOST_COLOURS * len(vertices_m)))


@building_kernel
def colour_apart(vertices_m: FloatArray, distance_m: float) -> IntArray:
    """Return a colour (n,) for each vertex; vertices of one colour are more than ``distance_m`` apart.

    Colour by colour, each takes every vertex left that is far enough from those it has.
    """
    n = vertices_m.shape[0]
    colours = np.full(n, -1, np.int32)
    members = np.empty(n, np.int32)
    left, colour = n, 0
    while left > 0:
        count = 0
        for node in range(n):
            if colours[node] >= 0:
                continue
            is_apart = True
            for k in range(count):
                squared = 0.0
                for axis in range(3):
                    squared += (vertices_m[node, axis] - vertices_m[members[k], axis]) ** 2
                if squared <= distance_m**2:
                    is_apart = False
                    break
            if is_apart:
                colours[node] = colour
                members[count] = node
                count += 1
        left -= count
        colour += 1
    return colours


@building_kernel
def _read_patches(
    starts: IntArray,
    neighbours: IntArray,
    loaded: IntArray,
    columns: IntArray,
    response: FloatArray,
    blocks: BlockArray,
) -> None:
    """Copy the rows of the ``loaded`` nodes out of ``response`` (n, c, 3, 3): R_ij is R_ji transposed."""
    for index in range(loaded.shape[0]):
        for k in range(starts[loaded[index]], starts[loaded[index] + 1]):
            for i in range(3):
                for j in range(3):
                    blocks[k, i, j] = response[neighbours[k], columns[index], j, i]


def _make_near_exact(
    model: ShellModel, basis: ModalBasis, starts: IntArray, neighbours: IntArray, blocks: BlockArray
) -> None:
    """Replace the blocks that the factor's pattern holds by K^-1 - Phi Lambda^-1 Phi^T, in place."""
    unknown = np.full(model.n_dofs, -1, np.int32)
    unknown[model.free_dofs] = np.arange(len(model.free_dofs), dtype=np.int32)
    translations = np.ascontiguousarray(unknown.reshape(-1, 6)[:, :3])
    inverse = SelectedInverse.of(model.K_free, model.factor)
    flexible = basis.Phi / basis.omega_rad_s
    rows = np.repeat(np.arange(basis.n_nodes, dtype=np.int32), np.diff(starts))
    for first in range(0, rows.size, _CHUNK):
        here = slice(first, first + _CHUNK)
        compliance = np.empty((rows[here].size, 3, 3))
        known = inverse.read_blocks(translations, rows[here], neighbours[here], compliance)
        a, b = flexible[rows[here][known]], flexible[neighbours[here][known]]
        blocks[here][known] = compliance[known] - a @ b.transpose(0, 2, 1)


def _read_levels(
    model: ShellModel,
    basis: ModalBasis,
    pattern: tuple[IntArray, IntArray],
    blocks: BlockArray,
    progress: Progress,
) -> None:
    """Write K^-1 - Phi Lambda^-1 Phi^T at the pairs of a pattern (starts, neighbours), level of nodes by level."""
    starts, neighbours = pattern
    mirror = _mirror(starts, neighbours)
    flexible = basis.Phi / basis.omega_rad_s
    place = np.full(basis.n_nodes, -1, np.int32)
    for nodes, response in compliance_rows(model):
        level = nodes[: response.shape[0]]
        place[nodes] = np.arange(nodes.size, dtype=np.int32)
        counts = starts[level + 1] - starts[level]
        pairs = np.concatenate([np.arange(starts[node], starts[node + 1]) for node in level])
        row, column = np.repeat(np.arange(level.size), counts), place[neighbours[pairs]]
        pairs, row, column = pairs[column >= 0], row[column >= 0], column[column >= 0]
        modal = flexible[level[row]] @ flexible[nodes[column]].transpose(0, 2, 1)
        blocks[pairs] = response[row, :, column, :] - modal
        blocks[mirror[pairs]] = blocks[pairs].transpose(0, 2, 1)
        progress("residual compliance", nodes.size / basis.n_nodes)
    progress("residual compliance", 1.0)


def _symmetrised(starts: IntArray, neighbours: IntArray, blocks: BlockArray) -> BlockArray:
    """Return the mean of each block and the transpose of its mirror image; probing leaves them a little apart."""
    return 0.5 * (blocks + blocks[_mirror(starts, neighbours)].transpose(0, 2, 1))


def _mirror(starts: IntArray, neighbours: IntArray) -> IntArray:
    """Return for each pair of a pattern the place (p,) of the same pair with its nodes exchanged."""
    n = starts.size - 1
    places = scipy.sparse.csr_array((np.arange(neighbours.size), neighbours, starts), shape=(n, n))
    return places.T.tocsr().data.astype(np.int32)
