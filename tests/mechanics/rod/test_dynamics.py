"""Vibration, energy, momentum and order of accuracy in time."""

import numpy as np
import pytest

from trocar.services.mechanics.rod import ImplicitIntegrator, SemiImplicitIntegrator, clamped, rod_energy, straight_rod
from trocar.services.mechanics.rod.implicit import SPECTRAL_RADIUS
from trocar.studies.published.rod_dynamics import spin, tip_errors_m
from trocar.studies.published.rods import (
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


@pytest.mark.parametrize("spectral_radius", [0.0, 0.3])
def test_numerical_damping_ratio_is_that_of_generalized_alpha(spectral_radius):
    dt_s, omega = 6e-3, mode_frequency_rad_s(0)
    ratio = damping_ratio(ring(example_rod(), 0, spectral_radius, dt_s, 800))
    root = generalized_alpha_roots(omega * dt_s, spectral_radius)
    slow = -np.log(root[np.argmax(np.abs(root))])
    assert ratio == pytest.approx(slow.real / abs(slow), rel=0.05)


def generalized_alpha_roots(omega_dt, spectral_radius):
    """What a step multiplies a mode with: Chung and Hulbert (1993), from displacements at four successive times."""
    rho = spectral_radius
    alpha_m, alpha_f = (2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0)
    gamma = 0.5 - alpha_m + alpha_f
    beta = 0.25 * (1.0 - alpha_m + alpha_f) ** 2
    mixed = np.array([[1.0 - alpha_f, alpha_f], [1.0 - alpha_m, alpha_m]])
    # x+ = x + v + (1/2 - beta) a + beta a+, v+ = v + (1 - gamma) a + gamma a+ in units of dt; unknowns (x, v, a)
    new = np.array([[1.0, 0.0, -beta], [0.0, 1.0, -gamma], [omega_dt**2 * mixed[0, 0], 0.0, mixed[1, 0]]])
    old = np.array([[1.0, 1.0, 0.5 - beta], [0.0, 1.0, 1.0 - gamma], [-(omega_dt**2) * mixed[0, 1], 0.0, -mixed[1, 1]]])
    return np.linalg.eigvals(np.linalg.solve(new, old))


@pytest.mark.parametrize("spectral_radius", [0.0, 0.6, 0.9, 1.0])
def test_what_a_step_cannot_resolve_shrinks_by_the_spectral_radius(spectral_radius):
    """Stretch waves of this rod are a hundred times faster than the step: a triple root of -rho is left."""
    properties = example_rod(axial_stiffness_n=1e5)
    integrator = ImplicitIntegrator(properties, clamped(X), spectral_radius=spectral_radius)
    state = straight_rod(properties, (0, 0, 0), X)
    state.slow_velocity_m_s = np.zeros((51, 3))  # as if it had moved before
    state.velocity_m_s[1:, 0] = 1e-9
    tip = []
    for _ in range(12):
        integrator.predict(state, np.zeros((51, 3)), 1e-3)
        tip.append(state.position_m[-1, 0] - LENGTH_M)
    characteristic = np.array([1.0, 3.0, 3.0, 1.0]) * spectral_radius ** np.arange(4)
    left = np.convolve(tip, characteristic, mode="valid")
    assert np.abs(left).max() < 0.02 * np.abs(tip).max()


def test_internal_damping_ratio_is_beta_omega_over_two():
    ratio = damping_ratio(ring(example_rod(internal_damping_s=2e-3), 0, 1.0, 2e-4, 4000))
    assert ratio == pytest.approx(2e-3 * mode_frequency_rad_s(0) / 2.0, rel=0.03)


@pytest.mark.parametrize("spectral_radius", [1.0, 0.6, 0.0])
def test_second_order_in_time_under_a_smooth_load(spectral_radius):
    def tip(dt_s):
        properties = example_rod(16, axial_stiffness_n=20.0)
        integrator = ImplicitIntegrator(properties, clamped(X), spectral_radius=spectral_radius)
        state = straight_rod(properties, (0, 0, 0), X)
        pull = np.zeros((17, 3))
        for step in range(round(0.03 / dt_s)):
            # a smooth load, taken where the step takes its forces: what it excites is resolved by every step here
            pull[-1, 1] = 0.02 * np.sin(np.pi * (step + 0.5) * dt_s / 0.03) ** 2
            integrator.predict(state, pull, dt_s)
        return state.position_m[-1, 1]

    reference = tip(2.5e-6)
    steps = np.array([2e-4, 1e-4, 5e-5])
    error = [abs(tip(dt_s) - reference) for dt_s in steps]
    assert np.polyfit(np.log(steps), np.log(error), 1)[0] == pytest.approx(2.0, abs=0.2)


def test_a_released_cantilever_is_right_to_a_twentieth_of_a_millimetre_and_converges_by_the_square_of_the_step():
    errors = tip_errors_m((1e-3, 5e-4, 2.5e-4), SPECTRAL_RADIUS, finest_s=2e-5)
    assert errors[0] < 0.05e-3
    assert np.log2(errors[:-1] / errors[1:]).min() > 1.8


@pytest.mark.parametrize("rate_rad_s", [20.0, 100.0])
def test_a_free_rod_keeps_spinning(rate_rad_s):
    momentum, energy = spin(rate_rad_s, SPECTRAL_RADIUS)
    assert momentum == pytest.approx(1.0, abs=0.01)
    # It starts unstretched: at 100 rad/s that sets off waves along it, which a step overshoots once.
    assert energy.max() < 1.01
    assert np.diff(energy[100:]).max() < 1e-6


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
    integrator = ImplicitIntegrator(properties, clamped(X), spectral_radius=1.0)
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


def test_energy_of_the_default_step_never_rises_but_by_what_its_damping_remembers():
    properties = example_rod(internal_damping_s=1e-3)
    integrator = ImplicitIntegrator(properties, clamped(X))
    state = let_go(integrator, properties)
    energy = [rod_energy(integrator.model, state).total_j]
    for _ in range(1000):
        integrator.predict(state, np.zeros((51, 3)), 1e-3)
        energy.append(rod_energy(integrator.model, state).total_j)
    assert (energy - np.minimum.accumulate(energy)).max() <= 1e-5 * energy[0]
    # What the material takes out of the first mode, beta omega^2, and hardly any more.
    assert energy[-1] == pytest.approx(np.exp(-1e-3 * mode_frequency_rad_s(0) ** 2) * energy[0], rel=0.3)


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


def test_implicit_conserves_linear_momentum_exactly_and_angular_momentum_to_second_order():
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
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(2.0, abs=0.3)
    assert errors[-1] < 1e-4
