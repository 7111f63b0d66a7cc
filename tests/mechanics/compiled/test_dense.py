"""LU factors by columns, against LAPACK."""

import numpy as np
import pytest

from trocar.services.mechanics.compiled.dense import factorise, solve_factorised


def solve(A, *rhs):
    """Factorise once and solve for each right-hand side; None if the matrix is singular."""
    columns, pivots = np.ascontiguousarray(A.T), np.zeros(len(A), np.int32)
    if not factorise(columns, pivots):
        return None
    solutions = [b.copy() for b in rhs]
    for x in solutions:
        solve_factorised(columns, pivots, x)
    return solutions


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 8, 31, 32, 33, 100])
def test_against_lapack(n):
    random = np.random.default_rng(n)
    A, rhs = random.normal(size=(n, n)), random.normal(size=(2, n))
    for b, x in zip(rhs, solve(A, *rhs), strict=True):
        np.testing.assert_allclose(x, np.linalg.solve(A, b), rtol=1e-9 * np.linalg.cond(A))
        assert np.abs(A @ x - b).max() < 1e-12 * n * np.abs(A).max() * np.abs(x).max()


@pytest.mark.parametrize("n", [5, 12])
def test_pivots_that_are_zero_or_tiny_are_passed_over(n):
    A = np.roll(np.eye(n), 1, axis=0) + 1e-17 * np.ones((n, n))
    b = np.arange(n, dtype=float)
    np.testing.assert_allclose(A @ solve(A, b)[0], b, atol=1e-12)


@pytest.mark.parametrize("column", [0, 3, 4, 9])
def test_a_singular_matrix_is_told(column):
    A = np.random.default_rng(1).normal(size=(10, 10))
    A[:, column] = 0.0
    assert solve(A, np.ones(10)) is None
