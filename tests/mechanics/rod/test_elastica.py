"""Large deflection of a cantilever against the elastica (Bisshopp and Drucker 1945; Mattiasson 1981)."""

import numpy as np
import pytest

from services.mechanics.rod import ImplicitIntegrator, clamped, straight_rod

from .helpers import EI, LENGTH_M, example_rod, settle

# P L^2 / EI: tip angle [rad], transverse w/L, axial shortening u/L
TIP_LOAD = {
    0.5: (0.24453, 0.16214, 0.01592),
    1.0: (0.46135, 0.30172, 0.05643),
    2.0: (0.78175, 0.49346, 0.16064),
    3.0: (0.98602, 0.60325, 0.25442),
    5.0: (1.21537, 0.71379, 0.38763),
    10.0: (1.43029, 0.81061, 0.55500),
}


def tip_under_load(load, n_segments=50):
    properties = example_rod(n_segments, axial_stiffness_n=1e4, internal_damping_s=0.01, viscous_drag_n_s_m2=0.1)
    state = straight_rod(properties, (0, 0, 0), (1, 0, 0))
    force = np.zeros((properties.n_particles, 3))
    force[-1, 2] = -load * EI / LENGTH_M**2
    settle(ImplicitIntegrator(properties, clamped((1, 0, 0))), state, force)
    last = state.position_m[-1] - state.position_m[-2]
    tip = state.position_m[-1] / LENGTH_M
    return np.arctan2(-last[2], last[0]), -tip[2], 1.0 - tip[0]


@pytest.mark.parametrize("load", TIP_LOAD)
def test_tip_of_50_segments_is_within_half_a_percent(load):
    np.testing.assert_allclose(tip_under_load(load), TIP_LOAD[load], rtol=5e-3)


def test_tip_deflection_converges_with_the_square_of_the_segment_length():
    n = np.array([8, 16, 32])
    fine = tip_under_load(5.0, 256)[1]
    error = [abs(tip_under_load(5.0, int(k))[1] - fine) for k in n]
    rate = -np.polyfit(np.log(n), np.log(error), 1)[0]
    assert rate == pytest.approx(2.0, abs=0.15)
