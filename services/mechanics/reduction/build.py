"""From a shell model to its reduced duct: modes, then the residual compliance."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from services.mechanics.fem import EigenModes, ShellModel, compute_modes
from services.mechanics.reduction.basis import ModalBasis
from services.mechanics.reduction.free_dofs import nodal_translations
from services.mechanics.reduction.residual import BlockArray
from services.mechanics.reduction.state import FloatArray, IntArray

Progress = Callable[[str, float], None]
"""Called with the name of the stage and the fraction of it done, 0 to 1."""

COLUMNS = 96
"""Right-hand sides solved together, a multiple of three: SuperLU then works on blocks, twice as fast a column."""


def ignore_progress(stage: str, fraction: float) -> None:
    """Report to nobody."""


def build_basis(model: ShellModel, n_modes: int, progress: Progress = ignore_progress) -> ModalBasis:
    """Return the lowest ``n_modes`` of a supported shell."""
    progress("factorisation", 0.0)
    model.factor  # noqa: B018  made at first use; named here so that the stage can be reported
    progress("factorisation", 1.0)
    progress("modes", 0.0)
    modes: EigenModes = compute_modes(model, n_modes)
    progress("modes", 1.0)
    return ModalBasis.from_modes(modes.omega_rad_s, modes.Phi)


def full_residual_bytes(n_nodes: int, dtype: type[np.floating] = np.float32) -> int:
    """Return the memory of R between all pairs of ``n_nodes`` nodes: 36 n^2 bytes in float32."""
    return 9 * np.dtype(dtype).itemsize * n_nodes**2


def fill_full_residual(
    model: ShellModel, basis: ModalBasis, out: BlockArray, progress: Progress = ignore_progress
) -> None:
    """Write R = K^-1 - Phi Lambda^-1 Phi^T into ``out`` (n, n, 3, 3), in m/N, block of columns by block."""
    n = basis.n_nodes
    per_block = COLUMNS // 3
    for start in range(0, n, per_block):
        nodes = np.arange(start, min(start + per_block, n), dtype=np.int32)
        out[nodes[0] : nodes[-1] + 1] = residual_columns(model, basis, nodes).transpose(1, 0, 3, 2)
        progress("residual compliance", (nodes[-1] + 1) / n)


def residual_columns(model: ShellModel, basis: ModalBasis, nodes: IntArray) -> FloatArray:
    """Return R between every node and ``nodes`` (k,), as (n, k, 3, 3): row axis third, column axis last."""
    loads = np.zeros((model.n_dofs, nodes.size, 3))
    for axis in range(3):
        loads[6 * nodes + axis, np.arange(nodes.size), axis] = 1.0
    free = np.asfortranarray(loads.reshape(model.n_dofs, -1)[model.free_dofs])
    compliance = nodal_translations(model, model.factor.solve(free))
    n, r = basis.n_nodes, basis.n_modes
    flexible = (basis.Phi[nodes] / basis.omega_rad_s**2).reshape(-1, r)
    columns = compliance.reshape(3 * n, -1) - basis.Phi.reshape(3 * n, r) @ flexible.T
    return columns.reshape(n, 3, nodes.size, 3).transpose(0, 2, 1, 3)
