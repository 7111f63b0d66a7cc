"""From a shell model to its reduced duct: modes, then the residual compliance.

Run with one BLAS thread (OPENBLAS_NUM_THREADS=1 before numpy is imported): with another number of them sums are rounded
otherwise and double modes come out turned otherwise, under the same key of the cache. Nor would a second thread help:
the triangular solves work on small blocks, which it never speeds up and, on a busy machine, slows down tenfold.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.fem import EigenModes, ShellModel, compute_modes
from trocar.services.mechanics.reduction.basis import ModalBasis
from trocar.services.mechanics.reduction.free_dofs import nodal_translations
from trocar.services.mechanics.reduction.residual.blocks import BlockArray
from trocar.services.mechanics.reduction.residual.level_inverse import compliance_rows

Progress = Callable[[str, float], None]
"""Called with the name of the stage and the fraction of it done, 0 to 1."""

BATCH = 16
"""Nodes loaded in one call of the solver, three directions each: it then works on blocks, twice as fast a column."""


def ignore_progress(stage: str, fraction: float) -> None:
    """Discard the progress."""


def build_basis(model: ShellModel, n_modes: int, progress: Progress = ignore_progress) -> ModalBasis:
    """Return the lowest ``n_modes`` of a supported shell."""
    progress("factorisation", 0.0)
    model.factor  # noqa: B018  made at first use; named here so that the stage can be reported
    progress("modes", 0.0)
    solves = 0

    def count() -> None:
        # Lanczos stops when it has converged: how many solves that takes is only known roughly.
        nonlocal solves
        solves += 1
        if solves % n_modes == 1:
            progress("modes", solves / (solves + n_modes))

    modes: EigenModes = compute_modes(model, n_modes, count)
    progress("modes", 1.0)
    return ModalBasis.from_modes(modes.omega_rad_s, modes.Phi)


def full_residual_bytes(n_nodes: int) -> int:
    """Return the memory of R between all pairs of ``n_nodes`` nodes in float32: 36 n^2 bytes."""
    return 36 * n_nodes**2


def fill_full_residual(
    model: ShellModel, basis: ModalBasis, out: BlockArray, progress: Progress = ignore_progress
) -> None:
    """Write R = K^-1 - Phi Lambda^-1 Phi^T into ``out`` (n, n, 3, 3), in m/N, level of nodes by level."""
    n = basis.n_nodes
    out[:] = 0.0
    flexible = basis.Phi / basis.omega_rad_s
    for nodes, response in compliance_rows(model):
        level = nodes[: response.shape[0]]
        modal = flexible[level].reshape(3 * level.size, -1) @ flexible[nodes].reshape(3 * nodes.size, -1).T
        blocks = (response - modal.reshape(response.shape)).transpose(0, 2, 1, 3).astype(out.dtype)
        out[level[:, None], nodes] = blocks
        out[nodes[:, None], level] = blocks.transpose(1, 0, 3, 2)
        progress("residual compliance", nodes.size / n)
    progress("residual compliance", 1.0)


def residual_response(model: ShellModel, basis: ModalBasis, nodes: IntArray, columns: IntArray) -> FloatArray:
    """Return what R makes of unit forces on ``nodes`` (k,), superposed where ``columns`` (k,) repeat.

    The result (n, c, 3, 3) holds for every node and column the displacement (third axis) under the force in
    each direction (last axis), in m/N.
    """
    n, r, c = basis.n_nodes, basis.n_modes, int(columns.max()) + 1
    loads = np.zeros((model.n_dofs, c, 3))
    modal = np.zeros((c, 3, r))
    for axis in range(3):
        loads[6 * nodes + axis, columns, axis] = 1.0
    np.add.at(modal, columns, basis.Phi[nodes] / basis.omega_rad_s**2)
    free = np.asfortranarray(loads.reshape(model.n_dofs, -1)[model.free_dofs])
    compliance = nodal_translations(model, model.factor.solve(free)).reshape(3 * n, -1)
    response = compliance - basis.Phi.reshape(3 * n, r) @ modal.reshape(-1, r).T
    return response.reshape(n, 3, c, 3).transpose(0, 2, 1, 3)
