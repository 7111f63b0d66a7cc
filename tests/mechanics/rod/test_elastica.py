"""Static shapes: the elastica (Bisshopp and Drucker 1945; Mattiasson 1981), the circle and the catenary."""

import numpy as np
import pytest
from scipy.optimize import brentq

from trocar.studies.published import rods as problems

# P L^2 / EI: tip angle [rad], transverse w/L, axial shortening u/L
TIP_LOAD = {
    0.5: (0.24453, 0.16214, 0.01592),
    1.0: (0.46135, 0.30172, 0.05643),
    2.0: (0.78175, 0.49346, 0.16064),
    3.0: (0.98602, 0.60325, 0.25442),
    5.0: (1.21537, 0.71379, 0.38763),
    10.0: (1.43029, 0.81061, 0.55500),
}


@pytest.mark.parametrize("load", TIP_LOAD)
def test_tip_of_50_segments_is_within_half_a_percent(load):
    np.testing.assert_allclose(problems.elastica_tip(load), TIP_LOAD[load], rtol=5e-3)


def test_tip_deflection_converges_with_the_square_of_the_segment_length():
    n = np.array([8, 16, 32])
    fine = problems.elastica_tip(5.0, 256)[1]
    error = [abs(problems.elastica_tip(5.0, int(k))[1] - fine) for k in n]
    rate = -np.polyfit(np.log(n), np.log(error), 1)[0]
    assert rate == pytest.approx(2.0, abs=0.15)


@pytest.mark.parametrize("n_segments", [12, 50])
def test_end_moment_of_two_pi_EI_over_L_closes_a_circle_exactly_at_any_resolution(n_segments):
    gap, curvature = problems.end_moment(n_segments)
    assert gap < 1e-9
    np.testing.assert_allclose(curvature, 1.0, rtol=1e-9)


def test_a_chain_without_bending_stiffness_hangs_in_a_catenary():
    span, length = 0.1, 0.15
    state, tension_n = problems.hanging_chain()
    a = brentq(lambda a: 2.0 * a * np.sinh(span / (2.0 * a)) - length, 0.01, 1.0)
    expected = a * (np.cosh((state.position_m[:, 0] - span / 2) / a) - np.cosh(span / (2 * a)))
    sag = a * (np.cosh(span / (2 * a)) - 1.0)
    np.testing.assert_allclose(state.position_m[:, 2], expected, rtol=0, atol=2e-3 * sag)
    # the first segment bears the weight of all but itself: half the rod less one half segment
    weight = problems.LINE_DENSITY * 9.81
    assert tension_n == pytest.approx(np.hypot(weight * a, weight * 0.5 * (length - length / 50)), rel=5e-3)
