"""Euler loads and the shape after buckling."""

import numpy as np
import pytest
from scipy.special import ellipk

from trocar.studies.published import rods as problems


def test_a_column_stays_straight_below_the_euler_load_and_not_above():
    assert abs(problems.buckled_tip_angle(0.99)) < 1e-4
    assert problems.buckled_tip_angle(1.01) > 0.2  # the elastica gives 0.281 rad


@pytest.mark.parametrize("angle_deg", [40.0, 90.0])
def test_angle_after_buckling_is_that_of_the_elastica(angle_deg):
    # P/P_cr = (2 K(sin(a/2)) / pi)^2; scipy's K takes the squared modulus
    ratio = (2.0 * ellipk(np.sin(np.radians(angle_deg) / 2.0) ** 2) / np.pi) ** 2
    assert np.degrees(problems.buckled_tip_angle(ratio)) == pytest.approx(angle_deg, rel=5e-3)


@pytest.mark.parametrize("ends", problems.EULER_FACTOR)
def test_thrust_of_a_column_shortened_past_buckling_is_the_euler_load(ends):
    assert problems.thrust_after_buckling_n(ends) == pytest.approx(problems.euler_load_n(ends), rel=5e-3)
