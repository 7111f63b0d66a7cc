"""LDL^T of a symmetric positive definite matrix of half-bandwidth 8: particles that see two neighbours each way.

Storage is by columns, ``band[j, a] = A[j + a, j]``, padded by 8 columns so that every inner loop has a constant length
and vectorises; the padding holds zeros in the band and does not reach the solution.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

HALF_BANDWIDTH = 8
RHS_BLOCK = 8  # right-hand sides solved side by side: one or two vector registers
_WIDTH = HALF_BANDWIDTH + 1


def empty_band(n_dofs: int) -> FloatArray:
    """Zeroed storage of a matrix of `n_dofs` rows, padding included."""
    return np.zeros((n_dofs + HALF_BANDWIDTH, _WIDTH))


@njit(cache=True, nogil=True, fastmath=False)
def factor_ldl(band: FloatArray) -> bool:
    """Factor in place: unit L below the diagonal, 1/D on it. False where a pivot is not positive (not SPD, or NaN).

    Costs 45 multiply-adds a row. Backward stable without pivoting because the matrix is positive definite.
    """
    for j in range(band.shape[0] - HALF_BANDWIDTH):
        pivot = band[j, 0]
        if not pivot > 0.0:
            return False
        inverse = 1.0 / pivot
        band[j, 0] = inverse
        for a in range(1, _WIDTH):
            lower = band[j, a] * inverse
            for b in range(a, _WIDTH):
                band[j + a, b - a] -= lower * band[j, b]
        for a in range(1, _WIDTH):
            band[j, a] *= inverse
    return True


@njit(cache=True, nogil=True, fastmath=False)
def solve_ldl(band: FloatArray, rhs: FloatArray) -> None:
    """Solve in place one right-hand side, (n_dofs + 8,) with zeroed padding."""
    n_dofs = band.shape[0] - HALF_BANDWIDTH
    for j in range(n_dofs):
        value = rhs[j]
        for a in range(1, _WIDTH):
            rhs[j + a] -= band[j, a] * value
    for a in range(n_dofs, n_dofs + HALF_BANDWIDTH):
        rhs[a] = 0.0
    for j in range(n_dofs - 1, -1, -1):
        value = rhs[j] * band[j, 0]
        for a in range(1, _WIDTH):
            value -= band[j, a] * rhs[j + a]
        rhs[j] = value


@njit(cache=True, nogil=True, fastmath=False)
def solve_ldl_block(band: FloatArray, first_dof: int, rhs: FloatArray) -> None:
    """Solve in place RHS_BLOCK right-hand sides, (n_dofs + 8, RHS_BLOCK), for the unknowns from `first_dof` on.

    The rows before `first_dof` must be zero in every column; they are neither read nor written, which saves the part of
    the forward sweep where nothing happens and the part of the backward sweep whose answer is not asked for.
    """
    n_dofs = band.shape[0] - HALF_BANDWIDTH
    for j in range(first_dof, n_dofs):
        for a in range(1, _WIDTH):
            lower = band[j, a]
            for r in range(RHS_BLOCK):
                rhs[j + a, r] -= lower * rhs[j, r]
    rhs[n_dofs:] = 0.0
    for j in range(n_dofs - 1, first_dof - 1, -1):
        for r in range(RHS_BLOCK):
            value = rhs[j, r] * band[j, 0]
            for a in range(1, _WIDTH):
                value -= band[j, a] * rhs[j + a, r]
            rhs[j, r] = value
