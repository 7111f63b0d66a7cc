"""Vibration, energy, momentum and order of accuracy in time."""

import numpy as np
import pytest

from services.mechanics.rod import ImplicitIntegrator, SemiImplicitIntegrator, clamped, rod_energy, straight_rod
from services.studies.rod_problems import (
    EI,
    LENGTH_M,
    X,
    example_rod,
    measured_frequency_rad_s,
    mode_frequency_rad_s,
    ring,
)


@pytest.mark.parametrize("mode", range(3))
def test_cantilever_frequencies(mode):
    assert measured_frequency_rad_s(mode) == pytest.approx(mode_frequency_rad_s(mode), rel=5e-3)


def damping_ratio(amplitude):
    """From the logarithmic decrement of successive peaks, two a period."""
    height = np.abs(amplitude)
    tops = height[1:-1][(height[1:-1] > height[:-2]) & (height[1:-1] > height[2:])]
    return -np.polyfit(np.arange(len(tops)), np.log(tops), 1)[0] / np.pi


@pytest.mark.parametrize("theta", [1.0, 0.75])
def test_numerical_damping_ratio_is_theta_minus_half_times_omega_dt(theta):
    ratio = damping_ratio(ring(example_rod(), 0, theta, 1e-3, 800))
    assert ratio == pytest.approx((theta - 0.5) * mode_frequency_rad_s(0) * 1e-3, rel=0.05)


def test_internal_damping_ratio_is_beta_omega_over_two():
    ratio = damping_ratio(ring(example_rod(internal_damping_s=2e-3), 0, 0.5, 2e-4, 4000))
    assert ratio == pytest.approx(2e-3 * mode_frequency_rad_s(0) / 2.0, rel=0.03)


@pytest.mark.parametrize(("theta", "order"), [(1.0, 1.0), (0.5, 2.0)])
def test_order_of_accuracy_in_time(theta, order):
    def tip(dt_s):
        properties = example_rod(16, axial_stiffness_n=20.0)
        integrator = ImplicitIntegrator(properties, clamped(X), theta=theta)
        state = straight_rod(properties, (0, 0, 0), X)
        pull = np.zeros((17, 3))
        for step in range(round(0.03 / dt_s)):
            # a smooth load, taken where the step takes its forces: what it excites is resolved by every step here
            pull[-1, 1] = 0.02 * np.sin(np.pi * (step + theta) * dt_s / 0.03) ** 2
            integrator.predict(state, pull, dt_s)
        return state.position_m[-1, 1]

    reference = tip(2.5e-6)
    steps = np.array([2e-4, 1e-4, 5e-5])
    error = [abs(tip(dt_s) - reference) for dt_s in steps]
    assert np.polyfit(np.log(steps), np.log(error), 1)[0] == pytest.approx(order, abs=0.2)


def let_go(integrator, properties):
    """A cantilever bent by a third of its length, at rest."""
    damped = ImplicitIntegrator(example_rod(internal_damping_s=0.02, viscous_drag_n_s_m2=0.05), clamped(X))
    state = straight_rod(properties, (0, 0, 0), X)
    load = np.zeros((51, 3))
    load[-1] = np.array([0.0, 0.4, -1.0]) * EI / LENGTH_M**2
    for _ in range(1000):
        damped.predict(state, load, 1e-3)
    state.velocity_m_s[:] = 0.0
    return state


def test_energy_of_the_undamped_midpoint_rule_does_not_drift_in_ten_thousand_steps():
    properties = example_rod()
    integrator = ImplicitIntegrator(properties, clamped(X), theta=0.5)
    state = let_go(integrator, properties)
    start = rod_energy(integrator.model, state).total_j
    energy = []
    for step in range(10_000):
        integrator.predict(state, np.zeros((51, 3)), 1e-4)
        if step % 100 == 99:
            energy.append(rod_energy(integrator.model, state).total_j / start)
    assert np.abs(np.array(energy) - 1.0).max() < 1e-3


def test_energy_of_the_undamped_semi_implicit_rod_oscillates_without_drift():
    properties = example_rod()
    integrator = SemiImplicitIntegrator(properties, clamped(X))
    state = let_go(integrator, properties)
    start = rod_energy(integrator.model, state).total_j
    energy = []
    for _ in range(100):  # 168 substeps each
        integrator.predict(state, np.zeros((51, 3)), 1e-3)
        energy.append(rod_energy(integrator.model, state).total_j / start)
    assert np.abs(np.array(energy) - 1.0).max() < 0.01
    assert abs(np.mean(energy[:50]) - np.mean(energy[50:])) < 1e-3


def test_energy_of_the_default_step_never_rises():
    properties = example_rod(internal_damping_s=1e-3)
    integrator = ImplicitIntegrator(properties, clamped(X))
    state = let_go(integrator, properties)
    energy = [rod_energy(integrator.model, state).total_j]
    for _ in range(1000):
        integrator.predict(state, np.zeros((51, 3)), 1e-3)
        energy.append(rod_energy(integrator.model, state).total_j)
    assert np.diff(energy).max() <= 1e-12 * energy[0]
    assert energy[-1] < 0.1 * energy[0]


def tumbling(properties):
    rng = np.random.default_rng(5)
    state = straight_rod(properties, (0.1, 0.2, 0.3), (1, 1, 0))
    shape = np.cumsum(rng.normal(size=(51, 3)), axis=0) * 0.02
    state.velocity_m_s[:] = shape + np.cross([5.0, -3.0, 20.0], state.position_m)
    return state


def momenta(properties, state):
    p = properties.particle_mass_kg()[:, None] * state.velocity_m_s
    return p.sum(axis=0), np.cross(state.position_m, p).sum(axis=0)


def test_semi_implicit_conserves_linear_and_angular_momentum_with_damping():
    properties = example_rod(internal_damping_s=1e-7)
    integrator = SemiImplicitIntegrator(properties)
    state = tumbling(properties)
    linear, angular = momenta(properties, state)
    for _ in range(20):
        integrator.predict(state, np.zeros((51, 3)), 1e-3)
    after = momenta(properties, state)
    np.testing.assert_allclose(after[0], linear, rtol=0, atol=1e-10 * np.linalg.norm(linear))
    np.testing.assert_allclose(after[1], angular, rtol=0, atol=1e-10 * np.linalg.norm(angular))


def test_implicit_conserves_linear_momentum_exactly_and_angular_momentum_to_first_order():
    errors = []
    steps = np.array([4e-4, 2e-4, 1e-4])
    for dt_s in steps:
        properties = example_rod(internal_damping_s=1e-3)
        integrator = ImplicitIntegrator(properties)
        state = tumbling(properties)
        linear, angular = momenta(properties, state)
        for _ in range(round(0.02 / dt_s)):
            integrator.predict(state, np.zeros((51, 3)), dt_s)
        after = momenta(properties, state)
        np.testing.assert_allclose(after[0], linear, rtol=0, atol=1e-9 * np.linalg.norm(linear))
        errors.append(np.linalg.norm(after[1] - angular) / np.linalg.norm(angular))
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(1.0, abs=0.3)
    assert errors[-1] < 0.02
