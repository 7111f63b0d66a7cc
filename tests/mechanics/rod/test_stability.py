"""Steps of 1 ms with a real catheter's stiffness, and the limit of the semi-implicit integrator."""

import numpy as np
import pytest

from tests.by_day import by_day
from trocar.services.mechanics.rod import (
    ImplicitIntegrator,
    SemiImplicitIntegrator,
    Supports,
    clamped,
    rod_energy,
    straight_rod,
)
from trocar.services.mechanics.rod.semi_implicit import take_substeps
from trocar.studies.published.rods import example_rod

X = (1.0, 0.0, 0.0)
NO_LOAD = np.zeros((51, 3))


def finite_and_unstretched(state, segment_length_m=2e-3, strain=1e-3):
    length = np.linalg.norm(np.diff(state.position_m, axis=0), axis=1)
    return np.isfinite(state.velocity_m_s).all() and np.abs(length / segment_length_m - 1.0).max() < strain


@pytest.mark.parametrize("EI_n_mm2", by_day([13.0, 33.0], [20.0]))
@pytest.mark.parametrize("EA_n", by_day([1.0, 1e5], [176.7]))
@pytest.mark.parametrize("speed_m_s", [1.0, 100.0])
def test_implicit_survives_violent_velocities_at_one_millisecond(EI_n_mm2, EA_n, speed_m_s):
    properties = example_rod(bending_stiffness_n_m2=EI_n_mm2 * 1e-6, axial_stiffness_n=EA_n)
    integrator = ImplicitIntegrator(properties, clamped(X))
    for seed in range(3):
        state = straight_rod(properties, (0, 0, 0), X)
        state.velocity_m_s[:] = speed_m_s * np.random.default_rng(seed).normal(size=(51, 3))
        energy = [rod_energy(integrator.model, state).total_j]
        for _ in range(300):
            integrator.predict(state, NO_LOAD, 1e-3)
            energy.append(rod_energy(integrator.model, state).total_j)
        assert np.diff(energy).max() <= 2e-3 * energy[0]
        assert energy[-1] < 0.1 * energy[0]
        assert finite_and_unstretched(state, strain=0.3 / EA_n if EA_n < 100.0 else 2e-3)


def test_a_violent_step_is_refined_and_a_gentle_one_is_not():
    properties = example_rod()
    stretch = {}
    for iterations in (1, 4):
        integrator = ImplicitIntegrator(properties, clamped(X), max_iterations=iterations)
        state = straight_rod(properties, (0, 0, 0), X)
        state.velocity_m_s[:] = 10.0 * np.random.default_rng(0).normal(size=(51, 3))
        integrator.predict(state, NO_LOAD, 1e-3)
        stretch[integrator.iterations] = rod_energy(integrator.model, state).stretch_j
    assert stretch[2] < 0.2 * stretch[1]
    weight = properties.particle_mass_kg()[:, None] * np.array([0.0, 0.0, -9.81])
    state = straight_rod(properties, (0, 0, 0), X)
    for _ in range(200):
        integrator.predict(state, weight, 1e-3)
        assert integrator.iterations == 1


@pytest.mark.parametrize("EI_n_mm2", [13.0, 33.0])
@pytest.mark.parametrize("seed", range(3))
def test_implicit_unfolds_a_crumpled_rod(EI_n_mm2, seed):
    properties = example_rod(bending_stiffness_n_m2=EI_n_mm2 * 1e-6, internal_damping_s=1e-3)
    integrator = ImplicitIntegrator(properties)
    state = straight_rod(properties, (0, 0, 0), X)
    state.position_m[:] = 0.01 * np.random.default_rng(seed).normal(size=(51, 3))
    for _ in range(3000):
        integrator.predict(state, NO_LOAD, 1e-3)
    assert finite_and_unstretched(state)
    assert rod_energy(integrator.model, state).bending_j < 1e-4


@pytest.mark.parametrize("twist", [{}, {"torsional_stiffness_n_m2": 17e-6}], ids=["plain", "twist"])
def test_implicit_survives_a_hand_that_jumps_and_particles_that_coincide(twist):
    properties = example_rod(**twist)
    integrator = ImplicitIntegrator(properties, Supports(held=(0, 25), start_direction=X))
    state = straight_rod(properties, (0, 0, 0), X)
    integrator.predict(state, NO_LOAD, 1e-3)
    state.position_m[10] = state.position_m[11]
    state.position_m[1] = state.position_m[0]
    rng = np.random.default_rng(0)
    centre = state.position_m[25].copy()
    for step in range(1000):
        if step % 10 == 0 and step < 800:
            integrator.held_target_m[1] = centre + rng.uniform([-0.04, -0.03, -0.03], [-0.01, 0.03, 0.03])
        integrator.predict(state, NO_LOAD, 1e-3)
        assert np.isfinite(state.position_m).all()
    assert finite_and_unstretched(state)


@pytest.mark.parametrize("dt_s", [1e-4, 5e-3, 0.05])
def test_implicit_settles_to_the_same_rest_at_any_step(dt_s):
    properties = example_rod(internal_damping_s=0.01, viscous_drag_n_s_m2=0.1)
    load = np.zeros((51, 3))
    load[-1, 2] = -0.005
    state = straight_rod(properties, (0, 0, 0), X)
    integrator = ImplicitIntegrator(properties, clamped(X))
    for _ in range(max(round(1.5 / dt_s), 300)):
        integrator.predict(state, load, dt_s)
    # the elastica for P L^2/EI = 2: w/L = 0.49346
    assert -state.position_m[-1, 2] / 0.1 == pytest.approx(0.49346, rel=2e-3)


def growth(properties, supports, ratio, steps=3000):
    """Energy after many semi-implicit steps of `ratio` times the computed limit, over that at the start."""
    integrator = SemiImplicitIntegrator(properties, supports)
    state = straight_rod(properties, (0, 0, 0), X)
    state.velocity_m_s[:] = 1e-3 * np.random.default_rng(1).normal(size=(51, 3))
    start = rod_energy(integrator.model, state).total_j
    target = integrator.held_target_m
    for _ in range(steps // 100):
        for _ in range(100):
            step = (ratio * integrator.stable_time_step_s, 1)
            motion = (state.position_m, state.velocity_m_s)
            take_substeps((integrator.model.address, integrator.work.address), motion, NO_LOAD, target, step)
        energy = rod_energy(integrator.model, state).total_j / start
        if not energy < 1e6:
            return np.inf
    return energy


@pytest.mark.parametrize(
    ("changes", "supports"),
    [
        ({}, None),
        ({"axial_stiffness_n": 0.05}, clamped(X)),  # bending is the stiffer here
        ({"internal_damping_s": 1e-5, "viscous_drag_n_s_m2": 1.0}, None),
    ],
    ids=["stretch", "bending", "damped"],
)
def test_semi_implicit_limit_is_where_it_was_computed(changes, supports):
    properties = example_rod(**changes)
    assert growth(properties, supports, 0.98) < 10.0
    assert growth(properties, supports, 1.02) == np.inf


def test_semi_implicit_limit_is_the_time_of_a_stretch_wave_along_a_segment():
    properties = example_rod()
    limit = SemiImplicitIntegrator(properties).stable_time_step_s
    assert limit == pytest.approx(2e-3 / np.sqrt(176.7 / 1.944e-3), rel=1e-2)


def test_semi_implicit_substeps_below_its_limit_and_refuses_more_than_it_may_take():
    integrator = SemiImplicitIntegrator(example_rod(), max_substeps=100)
    assert 1e-4 / integrator.substeps(1e-4) <= 0.9 * integrator.stable_time_step_s
    with pytest.raises(ValueError, match="168 substeps, more than 100"):
        integrator.substeps(1e-3)


@pytest.mark.parametrize("stiffness", by_day([0.01, 1000.0], [1.0]))
@pytest.mark.parametrize("dt_s", [1e-4, 1e-3, 0.05])
@pytest.mark.parametrize("spectral_radius", by_day([0.0, 1.0], [0.6]))
def test_small_vibrations_of_any_rod_gain_no_energy_at_any_step(stiffness, dt_s, spectral_radius):
    properties = example_rod(bending_stiffness_n_m2=25e-6 * stiffness, axial_stiffness_n=176.7 * stiffness)
    integrator = ImplicitIntegrator(properties, clamped(X), spectral_radius=spectral_radius)
    state = straight_rod(properties, (0, 0, 0), X)
    state.velocity_m_s[:] = 1e-6 * np.random.default_rng(0).normal(size=(51, 3))
    energy = [rod_energy(integrator.model, state).total_j]
    for _ in range(500):
        integrator.predict(state, NO_LOAD, dt_s)
        energy.append(rod_energy(integrator.model, state).total_j)
    assert integrator.iterations == 1
    assert (energy - np.minimum.accumulate(energy)).max() <= 3e-2 * energy[0]  # what the step's damping remembers


def test_spectral_radius_and_iterations_outside_their_range_are_refused():
    with pytest.raises(ValueError, match="spectral_radius"):
        ImplicitIntegrator(example_rod(), spectral_radius=1.1)
    with pytest.raises(ValueError, match="iterations"):
        ImplicitIntegrator(example_rod(), max_iterations=0)
