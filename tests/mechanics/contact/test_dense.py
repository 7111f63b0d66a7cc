"""Elimination in panels, against LAPACK."""

import numpy as np
import pytest

from services.mechanics.contact.dense import solve_dense


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 8, 31, 32, 33, 100])
def test_against_lapack(n):
    random = np.random.default_rng(n)
    A, b = random.normal(size=(n, n)), random.normal(size=n)
    expected, x = np.linalg.solve(A, b), b.copy()
    assert solve_dense(A.copy(), x)
    np.testing.assert_allclose(x, expected, rtol=1e-9 * np.linalg.cond(A))
    assert np.abs(A @ x - b).max() < 1e-12 * n * np.abs(A).max() * np.abs(x).max()


@pytest.mark.parametrize("n", [5, 12])
def test_pivots_that_are_zero_or_tiny_are_passed_over(n):
    A = np.roll(np.eye(n), 1, axis=0) + 1e-17 * np.ones((n, n))
    b = np.arange(n, dtype=float)
    x = b.copy()
    assert solve_dense(A.copy(), x)
    np.testing.assert_allclose(A @ x, b, atol=1e-12)


@pytest.mark.parametrize("column", [0, 3, 4, 9])
def test_a_singular_matrix_is_told(column):
    A = np.random.default_rng(1).normal(size=(10, 10))
    A[:, column] = 0.0
    assert not solve_dense(A, np.ones(10))
