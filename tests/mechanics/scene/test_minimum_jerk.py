"""Breakpoints joined by minimum-jerk motions."""

import numpy as np
import pytest

from trocar.services.mechanics.scene.minimum_jerk import minimum_jerk

TIMES = np.array([1.0, 3.0, 4.0])
VALUES = np.array([[0.0, 5.0], [0.1, 3.0], [-0.2, 3.0]])


def sample(time_s, times=TIMES, values=VALUES):
    value, rate = np.full((2, values.shape[1]), np.nan)
    minimum_jerk(times, values, time_s, value, rate)
    return value, rate


@pytest.mark.parametrize(("time_s", "row"), [(-1.0, 0), (1.0, 0), (3.0, 1), (4.0, 2), (9.0, 2)])
def test_it_passes_its_breakpoints_at_rest_and_holds_the_first_and_the_last(time_s, row):
    value, rate = sample(time_s)
    np.testing.assert_array_equal(value, VALUES[row])
    np.testing.assert_array_equal(rate, 0.0)


def test_between_two_breakpoints_no_polynomial_has_less_jerk():
    """The quintic with position, speed and acceleration given at both ends: 6 boundary conditions."""
    u = np.linspace(0.0, 1.0, 9)[1:-1]
    quintic = np.linalg.solve(
        [[1, 1, 1], [3, 4, 5], [6, 12, 20]],
        [1.0, 0.0, 0.0],
    )
    for at in u:
        value, rate = sample(1.0 + 2.0 * at)
        share = quintic @ [at**3, at**4, at**5]
        speed = quintic @ [3 * at**2, 4 * at**3, 5 * at**4] / 2.0
        np.testing.assert_allclose(value, VALUES[0] + share * (VALUES[1] - VALUES[0]), atol=1e-14)
        np.testing.assert_allclose(rate, speed * (VALUES[1] - VALUES[0]), atol=1e-13)


def test_one_breakpoint_is_held():
    value, rate = sample(0.3, np.array([0.5]), VALUES[:1])
    np.testing.assert_array_equal(value, VALUES[0])
    np.testing.assert_array_equal(rate, 0.0)
