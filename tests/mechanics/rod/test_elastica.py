"""Static shapes: the elastica (Bisshopp and Drucker 1945; Mattiasson 1981), the circle and the catenary."""

import numpy as np
import pytest
from scipy.optimize import brentq

from services.mechanics.rod import ImplicitIntegrator, Supports, clamped, straight_rod

from .helpers import EI, LENGTH_M, LINE_DENSITY, example_rod, settle

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


def test_end_moment_of_two_pi_EI_over_L_closes_a_full_circle():
    properties = example_rod(axial_stiffness_n=1e4, internal_damping_s=5e-3, viscous_drag_n_s_m2=0.05)
    integrator = ImplicitIntegrator(properties, clamped((1, 0, 0)))
    state = straight_rod(properties, (0, 0, 0), (1, 0, 0))
    force = np.zeros((51, 3))
    for step in range(4000):
        # a couple on the last segment, which turns with it
        moment = 2.0 * np.pi * EI / LENGTH_M * min(step / 1000, 1.0)
        arm = state.position_m[-1] - state.position_m[-2]
        force[-1] = moment * np.cross([0.0, 1.0, 0.0], arm) / (arm @ arm)
        force[-2] = -force[-1]
        integrator.predict(state, force, 2e-3)
    assert np.abs(state.velocity_m_s).max() < 1e-8
    assert np.linalg.norm(state.position_m[-1] - state.position_m[0]) < 5e-3 * LENGTH_M
    edge = np.diff(state.position_m, axis=0)
    angle = np.arccos(np.sum(edge[1:] * edge[:-1], axis=1) / properties.segment_length_m**2)
    np.testing.assert_allclose(angle / properties.segment_length_m, 2.0 * np.pi / LENGTH_M, rtol=5e-3)


def test_a_chain_without_bending_stiffness_hangs_in_a_catenary():
    span, length = 0.1, 0.15
    properties = example_rod(
        length_m=length, axial_stiffness_n=1e4, bending_stiffness_n_m2=0.0, internal_damping_s=1e-3,
        viscous_drag_n_s_m2=0.1,
    )
    integrator = ImplicitIntegrator(properties, Supports(held=(0, -1)))
    state = straight_rod(properties, (0, 0, 0), (1, 0, 0))
    s = np.linspace(0.0, 1.0, 51)
    state.position_m[:] = np.stack([span * s, 0 * s, -0.2 * s * (1 - s)], axis=1)
    weight = np.zeros((51, 3))
    weight[:, 2] = -9.81 * properties.particle_mass_kg()
    settle(integrator, state, weight, dt_s=5e-3, speed_m_s=1e-8)
    a = brentq(lambda a: 2.0 * a * np.sinh(span / (2.0 * a)) - length, 0.01, 1.0)
    expected = a * (np.cosh((state.position_m[:, 0] - span / 2) / a) - np.cosh(span / (2 * a)))
    sag = a * (np.cosh(span / (2 * a)) - 1.0)
    np.testing.assert_allclose(state.position_m[:, 2], expected, rtol=0, atol=2e-3 * sag)
    length_now = np.linalg.norm(np.diff(state.position_m, axis=0), axis=1)
    tension = 1e4 * (length_now[0] / properties.segment_length_m - 1.0)
    lowest = np.linalg.norm([LINE_DENSITY * 9.81 * a, LINE_DENSITY * 9.81 * (length - length / 50) / 2])
    assert tension == pytest.approx(lowest, rel=5e-3)
