"""Sparse factors of stiffness matrices."""

from __future__ import annotations

import numpy as np
import scipy


def factorise(matrix: scipy.sparse.csc_array[np.float64]) -> scipy.sparse.linalg.SuperLU:
    """Factorise a symmetric positive definite sparse matrix once, for many solves.

    SuperLU in symmetric mode: minimum degree on A + A^T and pivots from the diagonal, which positive
    definiteness allows without loss of stability, at a fraction of the unsymmetric default's fill.
    """
    return scipy.sparse.linalg.splu(
        matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )
