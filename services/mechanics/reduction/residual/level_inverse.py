"""K^-1 between all pairs of nodes, level by level: products of dense blocks in place of sparse solves.

Nodes in levels, each an edge farther from the held ones, couple with their own level and the two beside it only: K is
block tridiagonal, with D_i on the diagonal and E_i below it. With the Schur complements S_0 = D_0,
S_i = D_i - E_i-1 S_i-1^-1 E_i-1^T and X_i = -S_i^-1 E_i^T the inverse G follows from its last block backwards:
G_ii = S_i^-1 + X_i G_i+1,i+1 X_i^T, and G_ij = X_i G_i+1,j for j > i (Meurant, SIAM J. Matrix Anal. Appl. 13:707,
1992). X_i is how a level moves with the next one, the levels before it being free: nothing grows or cancels in products
of them, and the digits are those of a factorisation. All columns are carried back in one product a level, of
translations alone. As many solves with sparse factors, which read the whole of them for a few columns, took six times
as long on a tube of 3,024 nodes (22 s).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import scipy

from trocar.services.mechanics.arrays import BoolArray, FloatArray, IntArray
from trocar.services.mechanics.fem import ShellModel
from trocar.services.mechanics.surface.mesh import TriangleMesh, vertex_adjacency


def compliance_rows(model: ShellModel) -> Iterator[tuple[IntArray, FloatArray]]:
    """Yield K^-1 between the nodes of a level and those of it and of all later ones, the last level first.

    Each time the nodes of all those levels (l,), the level's own before the others, and what forces on them move its
    own k nodes by, (k, 3, l, 3) in m/N. Nodes without any free direction are in no level; a held translation is zero.
    """
    levels = node_levels(model.mesh, model.held_dofs)
    place = np.full(model.n_dofs, -1, np.int32)
    place[model.free_dofs] = np.arange(len(model.free_dofs), dtype=np.int32)
    unknown: IntArray = place.reshape(-1, 6)
    levels = [nodes[(unknown[nodes] >= 0).any(axis=1)] for nodes in levels]
    levels = [nodes for nodes in levels if nodes.size]
    flexibility, carried = _eliminate(model, [unknown[nodes][unknown[nodes] >= 0] for nodes in levels])
    nodes, rows, own = np.zeros(0, np.int32), np.zeros((0, 0)), np.zeros((0, 0))
    for level, S, X in zip(reversed(levels), reversed(flexibility), reversed(carried), strict=True):
        is_free = unknown[level] >= 0
        own = S + X @ own @ X.T
        rows = np.hstack([_at_translations(own.T, is_free).T, X @ rows])
        nodes = np.concatenate([level, nodes])
        yield nodes, _at_translations(rows, is_free).reshape(level.size, 3, nodes.size, 3)


def node_levels(mesh: TriangleMesh, held_dofs: IntArray) -> list[IntArray]:
    """Return the nodes by how many edges away from the nearest held one they are: no edge skips a level."""
    adjacency = vertex_adjacency(mesh).astype(np.float64)
    frontier = np.zeros(mesh.n_vertices, np.bool_)
    frontier[held_dofs // 6] = True
    seen, levels = np.zeros(mesh.n_vertices, np.bool_), []
    while frontier.any():
        levels.append(np.flatnonzero(frontier).astype(np.int32))
        seen |= frontier
        frontier = (adjacency @ frontier.astype(np.float64) > 0.0) & ~seen
    return levels


def _eliminate(model: ShellModel, levels: list[IntArray]) -> tuple[list[FloatArray], list[FloatArray]]:
    """Return S_i^-1 (m, m) and X_i (m, m of the next level) of levels of unknowns; the last X has no columns."""
    K = scipy.sparse.csr_array(model.K_free)
    flexibility, carried, below = [], [], None
    for unknowns, later in zip(levels, [*levels[1:], np.zeros(0, np.int32)], strict=True):
        rows = K[unknowns]
        S = rows[:, unknowns].toarray()
        if below is not None:
            S += below @ carried[-1]
        factor = scipy.linalg.cho_factor(S, lower=True, overwrite_a=True, check_finite=False)
        below = rows[:, later].toarray().T
        carried.append(-scipy.linalg.cho_solve(factor, below.T, check_finite=False))
        flexibility.append(scipy.linalg.cho_solve(factor, np.eye(unknowns.size), overwrite_b=True, check_finite=False))
    return flexibility, carried


def _at_translations(rows: FloatArray, is_free: BoolArray) -> FloatArray:
    """Return the rows (3 k, c) of a level's translations out of those (m, c) of its unknowns, zero where held."""
    out = np.zeros((is_free.shape[0], 6, rows.shape[1]))
    out[is_free] = rows
    return out[:, :3].reshape(-1, rows.shape[1])
