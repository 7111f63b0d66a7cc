"""LDL^T of a symmetric positive definite matrix of half-bandwidth 8: a particle couples to two others on either side.

Storage is by columns, ``band[j, a] = A[j + a, j]``, padded by 8 columns so that every inner loop has a constant length
and vectorises. The padding of the band holds zeros and does not affect the solution.
"""

from __future__ import annotations

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import kernel

HALF_BANDWIDTH = 3 * 2 + 2  # three coordinates of each of two others, and the other two of its own, as most
RHS_BLOCK = 16  # right-hand sides that are solved together, a few vector registers each
_WIDTH = HALF_BANDWIDTH + 1  # of what is stored of a column: the diagonal, and what is below


def empty_columns(n_dofs: int) -> FloatArray:
    """Return zeroed right-hand sides for `solve_ldl_block`, padding included."""
    return np.zeros((n_dofs + 2 * HALF_BANDWIDTH, RHS_BLOCK))


def empty_band(n_dofs: int) -> FloatArray:
    """Return zeroed storage of a matrix of ``n_dofs`` rows, padding included."""
    return np.zeros((n_dofs + HALF_BANDWIDTH, _WIDTH))


@kernel
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


@kernel
def solve_ldl(band: FloatArray, rhs: FloatArray) -> None:
    """Solve in place one right-hand side, (n_dofs + 8,) with zeroed padding.

    The last eight values stay in registers: a value that is read from memory just after it was written costs more than
    its eight products.
    """
    n_dofs = band.shape[0] - HALF_BANDWIDTH
    x1 = x2 = x3 = x4 = x5 = x6 = x7 = x8 = 0.0
    for j in range(n_dofs):
        far = _lower(band, j, 8) * x8 + _lower(band, j, 7) * x7 + _lower(band, j, 6) * x6 + _lower(band, j, 5) * x5
        near = _lower(band, j, 4) * x4 + _lower(band, j, 3) * x3 + _lower(band, j, 2) * x2
        value = rhs[j] - (far + near) - _lower(band, j, 1) * x1
        x8, x7, x6, x5, x4, x3, x2, x1 = x7, x6, x5, x4, x3, x2, x1, value
        rhs[j] = value
    x1 = x2 = x3 = x4 = x5 = x6 = x7 = x8 = 0.0
    for j in range(n_dofs - 1, -1, -1):
        far = band[j, 8] * x8 + band[j, 7] * x7 + band[j, 6] * x6 + band[j, 5] * x5
        near = band[j, 4] * x4 + band[j, 3] * x3 + band[j, 2] * x2
        value = rhs[j] * band[j, 0] - (far + near) - band[j, 1] * x1
        x8, x7, x6, x5, x4, x3, x2, x1 = x7, x6, x5, x4, x3, x2, x1, value
        rhs[j] = value
    for a in range(n_dofs, n_dofs + HALF_BANDWIDTH):
        rhs[a] = 0.0


@kernel
def _lower(band: FloatArray, row: int, a: int) -> float:
    """Return L[row, row - a], zero before the first column."""
    return band[row - a, a] if row >= a else 0.0


@kernel
def solve_ldl_block(band: FloatArray, first_dof: int, rhs: FloatArray) -> None:
    """Solve in place RHS_BLOCK right-hand sides, (n_dofs + 16, RHS_BLOCK), for the unknowns from ``first_dof`` on.

    Unknown j is row j + 8, between zeroed paddings; the eight rows before ``first_dof`` must be zero too. Rows before
    those are neither read nor written: their forward sweep would change nothing, and their solution is not needed. The
    loops are written out by diagonals, so that a new value stays in registers.
    """
    n_dofs = band.shape[0] - HALF_BANDWIDTH
    for j in range(first_dof, n_dofs):
        l1, l2, l3, l4 = _lower(band, j, 1), _lower(band, j, 2), _lower(band, j, 3), _lower(band, j, 4)
        l5, l6, l7, l8 = _lower(band, j, 5), _lower(band, j, 6), _lower(band, j, 7), _lower(band, j, 8)
        for r in range(RHS_BLOCK):
            near = l1 * rhs[j + 7, r] + l2 * rhs[j + 6, r] + l3 * rhs[j + 5, r] + l4 * rhs[j + 4, r]
            far = l5 * rhs[j + 3, r] + l6 * rhs[j + 2, r] + l7 * rhs[j + 1, r] + l8 * rhs[j, r]
            rhs[j + 8, r] -= near + far
    for j in range(n_dofs - 1, first_dof - 1, -1):
        d, l1, l2, l3, l4 = band[j, 0], band[j, 1], band[j, 2], band[j, 3], band[j, 4]
        l5, l6, l7, l8 = band[j, 5], band[j, 6], band[j, 7], band[j, 8]
        for r in range(RHS_BLOCK):
            near = l1 * rhs[j + 9, r] + l2 * rhs[j + 10, r] + l3 * rhs[j + 11, r] + l4 * rhs[j + 12, r]
            far = l5 * rhs[j + 13, r] + l6 * rhs[j + 14, r] + l7 * rhs[j + 15, r] + l8 * rhs[j + 16, r]
            rhs[j + 8, r] = d * rhs[j + 8, r] - near - far
