"""The law fitted to squeezes: what a stretched wall beside a support does is not paid for by the wall elsewhere."""

import numpy as np
import pytest

from trocar.services.mechanics.reduction.softening.softening_law import LARGEST_RHO, Sample, alike, fit_law, parts

FROM_SUPPORT = np.array([3.0, 0.2])
"""Of the two nodes, in widths of the lumen."""


def giving(rho):
    """Of a wall that folds: 3 rho at first, and less the more it folds."""
    return 3.0 * rho / (1.0 + 1.5 * rho)


def stretched(rho):
    """Of one that gives way at first and is a membrane then."""
    return 3.0 * rho / (1.0 + 4.0 * rho) - 2.3 * rho**2 / (rho**2 + 0.4**2)


def samples(node, work, largest):
    place = np.eye(2)[node]
    return [Sample(rho, work(rho), 0.5, place) for rho in np.linspace(0.2, 1.0, 5) * largest]


@pytest.fixture(scope="module")
def law():
    among = alike(np.abs(np.subtract.outer(FROM_SUPPORT, FROM_SUPPORT)), FROM_SUPPORT, FROM_SUPPORT)
    return fit_law([*samples(0, giving, 0.4), *samples(1, stretched, 5.0), *samples(1, stretched, 0.9)], among, among)


@pytest.mark.parametrize(("node", "work", "rho"), [(0, giving, 0.15), (0, giving, 0.3), (1, stretched, 0.6)])
def test_a_squeeze_far_along_the_law_leaves_the_rest_of_it_right(law, node, work, rho):
    at = np.interp(rho, law.rho, law.coefficients[node] @ law.work)
    assert at == pytest.approx(work(rho), abs=0.05)


def test_its_points_follow_it_near_zero_however_far_a_squeeze_went(law):
    assert law.rho[-1] <= LARGEST_RHO
    between = 0.5 * (law.rho[1:] + law.rho[:-1])
    error = law.coefficients[0] @ (0.5 * (law.work[:, 1:] + law.work[:, :-1]) - parts(between))
    assert np.abs(error).max() < 0.01
