import numpy as np
import pytest

from trocar.services.mechanics.rod.banded import (
    RHS_BLOCK,
    empty_band,
    empty_columns,
    factor_ldl,
    solve_ldl,
    solve_ldl_block,
)

N = 153


@pytest.fixture
def system():
    """A random SPD matrix of half-bandwidth 8, dense and banded."""
    rng = np.random.default_rng(1)
    dense = np.eye(N)
    for i in range(0, N - 8, 3):
        block = rng.normal(size=(9, 9))
        dense[i : i + 9, i : i + 9] += block @ block.T
    band = empty_band(N)
    for j in range(N):
        for a in range(min(9, N - j)):
            band[j, a] = dense[j + a, j]
    return dense, band


def test_solve_agrees_with_numpy(system):
    dense, band = system
    rhs = np.zeros(N + 8)
    rhs[:N] = np.random.default_rng(2).normal(size=N)
    expected = np.linalg.solve(dense, rhs[:N])
    assert factor_ldl(band)
    solve_ldl(band, rhs)
    np.testing.assert_allclose(rhs[:N], expected, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("first", [0, 30, 152])
def test_block_solve_agrees_with_numpy_from_the_first_loaded_row(system, first):
    dense, band = system
    rhs = empty_columns(N)
    unknowns = slice(8, N + 8)
    rhs[8 + first : N + 8] = np.random.default_rng(3).normal(size=(N - first, RHS_BLOCK))
    expected = np.linalg.solve(dense, rhs[unknowns])
    assert factor_ldl(band)
    rhs[:first] = np.nan  # what was there before is not read
    solve_ldl_block(band, first, rhs)
    np.testing.assert_allclose(rhs[unknowns][first:], expected[first:], rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("bad", [-1.0, 0.0, np.nan])
def test_a_matrix_that_is_not_positive_definite_is_reported(system, bad):
    _, band = system
    band[40, 0] = bad
    assert not factor_ldl(band)
