"""Blocked Gaussian elimination of a dense matrix: the trailing matrix is updated once for every panel of columns."""

from __future__ import annotations

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.compiled import kernel, summing_kernel

#: Columns of a panel. The trailing matrix is loaded and stored once for each panel, not once for each column.
PANEL = 4
#: Least fraction of a column's squares that its pivot has: swaps are rare, and as no multiplier is above 10, the square
#: root of its inverse, rounding errors hardly grow.
THRESHOLD = 0.01


@kernel
def factorise(columns: FloatArray, pivots: IntArray) -> bool:
    """Factorise in place a matrix (n, n) whose columns are the rows of ``columns``; return False if it is singular.

    It is an LU factorisation with threshold pivoting (Golub and Van Loan, "Matrix Computations", 3.4); ``pivots`` (n,)
    are the rows swapped in each step. Stored by columns, all long loops run over contiguous memory.
    """
    n = columns.shape[0]
    for first in range(0, n, PANEL):
        end = min(first + PANEL, n)
        for k in range(first, end):
            pivots[k] = _bring_pivot(columns, k)
            if columns[k, k] == 0.0:
                return False
            inverse = 1.0 / columns[k, k]
            below = columns[k, k + 1 :]
            for i in range(below.shape[0]):
                below[i] *= inverse
            for c in range(k + 1, end):
                _subtract(columns[c, k + 1 :], columns[c, k], below)
        if end < n:
            _update_rest(columns, first, end)
    return True


@kernel
def _bring_pivot(columns: FloatArray, k: int) -> int:
    """Bring the largest entry of column k into row k if that row has a small one; return its row."""
    pivot, rest = k, columns[k, k:]
    if rest[0] * rest[0] < THRESHOLD * sum_of_products(rest, rest, rest.shape[0]):
        for i in range(rest.shape[0]):
            if abs(rest[i]) > abs(columns[k, pivot]):
                pivot = k + i
        for c in range(columns.shape[0]):  # the factors to the left move with their rows
            columns[c, k], columns[c, pivot] = columns[c, pivot], columns[c, k]
    return pivot


@kernel
def _subtract(target: FloatArray, factor: float, column: FloatArray) -> None:
    """Subtract a multiple of a column. An index that may be negative would keep the loop from being vectorised."""
    for i in range(target.shape[0]):
        target[i] -= factor * column[i]


@kernel
def _update_rest(columns: FloatArray, first: int, end: int) -> None:
    """Update the columns behind a full panel."""
    a, b, c, d = columns[first], columns[first + 1], columns[first + 2], columns[first + 3]
    u, v, w, x = a[end:], b[end:], c[end:], d[end:]
    for k in range(end, columns.shape[0]):
        column = columns[k]
        p = column[first]
        q = column[first + 1] - p * a[first + 1]
        r = column[first + 2] - p * a[first + 2] - q * b[first + 2]
        s = column[first + 3] - p * a[first + 3] - q * b[first + 3] - r * c[first + 3]
        column[first + 1], column[first + 2], column[first + 3] = q, r, s
        rest = column[end:]
        for i in range(rest.shape[0]):
            rest[i] -= p * u[i] + q * v[i] + r * w[i] + s * x[i]


@kernel
def solve_factorised(columns: FloatArray, pivots: IntArray, b: FloatArray) -> None:
    """Solve with the factors of a matrix; b (n,) becomes the solution."""
    n = b.shape[0]
    for k in range(n):
        b[k], b[pivots[k]] = b[pivots[k]], b[k]
    for k in range(n):
        _subtract(b[k + 1 :], b[k], columns[k, k + 1 :])
    for k in range(n - 1, -1, -1):
        b[k] /= columns[k, k]
        _subtract(b[:k], b[k], columns[k, :k])


@summing_kernel
def sum_of_products(a: FloatArray, b: FloatArray, n: int) -> float:
    """Return the scalar product of the first n items of two arrays."""
    total = 0.0
    for k in range(n):
        total += a[k] * b[k]
    return total
