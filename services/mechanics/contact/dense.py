"""Blocked Gaussian elimination of a dense matrix: the trailing matrix is updated once for every panel of columns."""

from __future__ import annotations

from services.mechanics.arrays import FloatArray
from services.mechanics.compiled import inlined_kernel, summing_kernel

#: Columns of a panel. The trailing matrix is loaded and stored once for each panel, not once for each column.
PANEL = 4


@inlined_kernel
def solve_dense(A: FloatArray, b: FloatArray) -> bool:
    """Solve A (n, n) x = b (n,) by elimination with partial pivoting; return False if A is singular.

    b becomes x, and A is overwritten (Golub and Van Loan, "Matrix Computations", 3.4).
    """
    n = b.shape[0]
    for first in range(0, n, PANEL):
        end = min(first + PANEL, n)
        for k in range(first, end):
            if not _bring_pivot(A, b, k):
                return False
            _eliminate_in_panel(A, b, k, end)
        _complete_rows(A, first, end)
        _update_rest(A, first, end)
    _substitute_back(A, b)
    return True


@inlined_kernel
def _bring_pivot(A: FloatArray, b: FloatArray, k: int) -> bool:
    """Swap the row with the largest entry of column k, from row k on, into row k; return False if all are zero."""
    n = b.shape[0]
    pivot = k
    for i in range(k + 1, n):
        if abs(A[i, k]) > abs(A[pivot, k]):
            pivot = i
    if pivot != k:
        for j in range(n):  # the factors to the left move with their rows
            A[k, j], A[pivot, j] = A[pivot, j], A[k, j]
        b[k], b[pivot] = b[pivot], b[k]
    return bool(A[k, k] != 0.0)


@inlined_kernel
def _eliminate_in_panel(A: FloatArray, b: FloatArray, k: int, end: int) -> None:
    """Eliminate column k within the panel and in b; the factors are stored in place of the zeros."""
    inverse = 1.0 / A[k, k]
    for i in range(k + 1, b.shape[0]):
        factor = A[i, k] * inverse
        A[i, k] = factor
        for j in range(k + 1, end):
            A[i, j] -= factor * A[k, j]
        b[i] -= factor * b[k]


@inlined_kernel
def _complete_rows(A: FloatArray, first: int, end: int) -> None:
    """Eliminate to the right of the panel in the panel's own rows."""
    n = A.shape[0]
    for k in range(first, end):
        for i in range(k + 1, end):
            factor = A[i, k]
            for j in range(end, n):
                A[i, j] -= factor * A[k, j]


@inlined_kernel
def _update_rest(A: FloatArray, first: int, end: int) -> None:
    """Update the trailing matrix by the panel's rows; a panel shorter than `PANEL` is the last one and has none."""
    n = A.shape[0]
    if end - first < PANEL:
        return
    for i in range(end, n):
        p, q, r, s = A[i, first], A[i, first + 1], A[i, first + 2], A[i, first + 3]
        for j in range(end, n):
            A[i, j] -= p * A[first, j] + q * A[first + 1, j] + r * A[first + 2, j] + s * A[first + 3, j]


@summing_kernel
def _substitute_back(A: FloatArray, b: FloatArray) -> None:
    """Solve with the upper triangle."""
    for k in range(b.shape[0] - 1, -1, -1):
        total = 0.0
        for j in range(k + 1, b.shape[0]):
            total += A[k, j] * b[j]
        b[k] = (b[k] - total) / A[k, k]


@summing_kernel
def sum_of_products(a: FloatArray, b: FloatArray, n: int) -> float:
    """Return the scalar product of the first n items of two arrays."""
    total = 0.0
    for k in range(n):
        total += a[k] * b[k]
    return total
