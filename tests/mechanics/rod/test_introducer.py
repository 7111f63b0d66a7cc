"""The introducer."""

import numpy as np
import pytest

from tests.by_day import by_day
from trocar.services.mechanics.rod import (
    ImplicitIntegrator,
    Introducer,
    Supports,
    rod_along,
    rod_energy,
    straight_rod,
)
from trocar.services.mechanics.rod.model import build_model
from trocar.studies.published.rods import EI, example_rod
from trocar.studies.rod_forces import internal_forces

X = (1.0, 0.0, 0.0)
INTRODUCER = ((0.0, 0.0, 0.0), (0.03, 0.0, 0.0))


def in_introducer(properties, supports, integrator=ImplicitIntegrator):
    """A rod that starts 41 mm before the introducer's entry, so that no particle is in an end plane."""
    return integrator(properties, supports), straight_rod(properties, (-0.041, 0, 0), X)


def push(integrator, state, load, speed_m_s, steps, dt_s=1e-3):
    tip = []
    for _ in range(steps):
        integrator.held_target_m[0] = state.position_m[0] + np.array(X) * speed_m_s * dt_s
        integrator.predict(state, load, dt_s)
        tip.append(state.position_m[-1].copy())
    return np.array(tip)


def test_the_part_beyond_the_introducer_bends_like_a_cantilever_clamped_at_its_exit():
    properties = example_rod(100, internal_damping_s=5e-3, viscous_drag_n_s_m2=0.05)
    integrator, state = in_introducer(properties, Supports(held=(0,), introducer=Introducer(*INTRODUCER)))
    load = np.zeros((101, 3))
    load[-1, 2] = -1e-4
    push(integrator, state, load, 0.0, 2000)
    free = state.position_m[-1, 0] - 0.03
    assert -state.position_m[-1, 2] == pytest.approx(1e-4 * free**3 / (3.0 * EI), rel=0.10)
    # a clamp that gives a little: the particles that hold the slope are one or two segments back
    assert -state.position_m[-1, 2] > 1e-4 * free**3 / (3.0 * EI)
    inside = (state.position_m[:, 0] > 0.0) & (state.position_m[:, 0] < 0.03)
    assert inside.sum() >= 29
    assert np.abs(state.position_m[inside, 1:]).max() < 1e-5


def test_sliding_through_moves_the_tip_without_jumps():
    properties = example_rod(internal_damping_s=5e-3, viscous_drag_n_s_m2=0.05)
    integrator, state = in_introducer(properties, Supports(held=(0,), introducer=Introducer(*INTRODUCER)))
    load = np.zeros((51, 3))
    load[-1, 2] = -1e-3
    push(integrator, state, load, 0.0, 1500)
    tip = push(integrator, state, load, 0.02, 1000)  # ten segments pass each plane
    velocity = np.diff(tip, axis=0) / 1e-3
    assert tip[-1, 0] - tip[0, 0] == pytest.approx(0.02, rel=0.02)
    assert np.abs(velocity[100:, 0] - 0.02).max() < 2e-3
    assert np.abs(np.diff(velocity[:, 2])).max() < 2e-3


def test_without_friction_the_introducer_lets_the_rod_slide_freely():
    properties = example_rod()
    integrator, state = in_introducer(properties, Supports(introducer=Introducer(*INTRODUCER)))
    pull = np.zeros((51, 3))
    pull[:, 0] = 0.1 * properties.particle_mass_kg()
    for _ in range(100):
        integrator.predict(state, pull, 1e-3)
    np.testing.assert_allclose(state.velocity_m_s[:, 0], 0.01, rtol=1e-9)


def axial(state, particle):
    return state.position_m[particle, 0]


def test_a_rod_that_is_pulled_hard_stays_in_its_introducer():
    """Pulled by the tip the first particle stops two segments before the exit; pushed back, 5 mm stay outside."""
    properties = example_rod(internal_damping_s=5e-3, viscous_drag_n_s_m2=100.0)
    introducer = Introducer(*INTRODUCER)
    for force_n in (5.0, -5.0):
        integrator, state = in_introducer(properties, Supports(introducer=introducer))
        pull = np.zeros((51, 3))
        pull[:, 0] = force_n / 51
        for _ in range(1000):
            integrator.predict(state, pull, 1e-3)
        assert np.abs(state.velocity_m_s).max() < 1e-6
        give_m = 5.0 / introducer.stop_stiffness_n_m
        if force_n > 0.0:
            assert axial(state, 0) == pytest.approx(0.03 - 2 * 0.002 + give_m, rel=1e-4)
        else:
            # the point that stops lies between the particles 4 and 6 mm from the tip
            assert axial(state, 50 - 3) == pytest.approx(0.03 - 0.001 - give_m, rel=1e-4)


@pytest.mark.parametrize("n_segments", [33, 50, 71, 100])
@pytest.mark.parametrize("least_tip_m", [5e-3, 7.3e-3])
def test_the_same_length_of_tip_stays_out_whatever_the_segments(n_segments, least_tip_m):
    properties = example_rod(n_segments, internal_damping_s=5e-3, viscous_drag_n_s_m2=0.5)
    supports = Supports(introducer=Introducer(*INTRODUCER, least_tip_m=least_tip_m))
    integrator, state = ImplicitIntegrator(properties, supports), straight_rod(properties, (-0.06, 0, 0), X)
    load = np.zeros_like(state.position_m)
    load[0, 0] = -0.05
    for _ in range(3000):
        integrator.predict(state, load, 1e-3)
    assert state.position_m[-1, 0] - 0.03 == pytest.approx(least_tip_m, rel=0.01)


def test_a_rod_that_runs_into_its_stop_gains_no_energy():
    properties = example_rod()
    integrator, state = in_introducer(properties, Supports(introducer=Introducer(*INTRODUCER)))
    state.velocity_m_s[:, 0] = 0.3
    start_j = rod_energy(integrator.model, state).total_j
    energy_j = []
    for _ in range(400):
        integrator.predict(state, np.zeros((51, 3)), 1e-3)
        energy_j.append(rod_energy(integrator.model, state).total_j)
    # What rings up to start_j / 200 is stretch that each step's one linearisation leaves.
    assert np.diff(energy_j).max() < 5e-3 * start_j
    assert max(energy_j) <= start_j * (1.0 + 1e-9)
    assert state.velocity_m_s[:, 0].mean() < 0.0
    assert axial(state, 0) < 0.03


@pytest.mark.parametrize("damping_s", [0.0, 2e-4])
@pytest.mark.parametrize("aside_m", by_day([10e-3, 20e-3], [14e-3]))
@pytest.mark.parametrize("held", by_day([(40, 41), (40,)], [((35, 36),)]))
def test_a_bent_rod_that_is_held_beside_its_introducer_comes_to_rest(held, aside_m, damping_s):
    """It swung to and fro along the axis from step to step, at up to 0.3 m/s for ever, by energy from nowhere."""
    properties = example_rod(internal_damping_s=damping_s, viscous_drag_n_s_m2=0.05)
    supports = Supports(held=held, introducer=Introducer((0.0, 0.0, 0.0), (0.025, 0.0, 0.0)))
    integrator, state = ImplicitIntegrator(properties, supports), straight_rod(properties, (-0.026, 0, 0), X)
    start_m = state.position_m[list(held)].copy()
    for share in np.linspace(0.0, 1.0, 200):
        eased = share**2 * (3.0 - 2.0 * share)
        integrator.held_target_m[:] = start_m + eased * aside_m * np.array([-0.2, 1.0, 0.0])
        integrator.predict(state, np.zeros((51, 3)), 1e-3)
    energy_j, speed_m_s = [], []
    for _ in range(1500):
        integrator.predict(state, np.zeros((51, 3)), 1e-3)
        energy_j.append(rod_energy(integrator.model, state).total_j)
        speed_m_s.append(np.abs(state.velocity_m_s).max())
    # What swings while the hand moves, where no step is looked at, gains 2e-4 until it is caught.
    assert np.maximum(np.diff(energy_j[100:]), 0.0).sum() < 1e-5 * energy_j[0]
    assert max(speed_m_s[-200:]) < 1e-3


def test_a_part_that_swings_past_the_introducer_outside_is_not_taken_for_the_part_inside():
    """The free end folds back beside the introducer, across both planes: only the part inside feels it."""
    properties = example_rod(100)
    curve = np.array([(-0.011, 0, 0), (0.035, 0, 0), (0.035, 0.008, 0), (-0.02, 0.008, 0)])
    state = rod_along(properties, curve)
    feels = [
        internal_forces(build_model(properties, Supports(introducer=introducer)), state)
        for introducer in (Introducer(*INTRODUCER), None)
    ]
    outside = state.position_m[:, 1] > 1e-4
    assert outside.sum() > 50
    assert np.array_equal(feels[0][outside], feels[1][outside])
    state.position_m[20, 2] += 1e-4
    moved = internal_forces(build_model(properties, Supports(introducer=Introducer(*INTRODUCER))), state)
    assert moved[20, 2] < -9.0


@pytest.mark.parametrize("plane", INTRODUCER)
def test_a_particle_that_is_pushed_aside_passes_a_plane_without_a_jump_of_its_force(plane):
    """Where the force along the axis jumped, such a particle came to lie on the plane, and no iteration ended."""
    properties = example_rod()
    integrator, state = in_introducer(properties, Supports(introducer=Introducer(*INTRODUCER)))
    particle = int(np.abs(state.position_m[:, 0] - plane[0]).argmin())
    forces_n = []
    for beyond_m in (-1e-9, 1e-9):
        state.position_m[:, 0] += plane[0] + beyond_m - state.position_m[particle, 0]
        state.position_m[particle, 1] = 0.1e-3
        forces_n.append(internal_forces(integrator.model, state)[particle])
    # The spring's stiffness times the motion is 2e-4 N; what jumped was 0.25 N.
    np.testing.assert_allclose(*forces_n, rtol=0.0, atol=1e-3)


def test_newton_iterations_end_wherever_particles_are_at_the_exit():
    """A hand bends the rod hard beside the exit and slides it by a segment: each step is solved, not broken off."""
    properties = example_rod(internal_damping_s=2e-4, viscous_drag_n_s_m2=0.05)
    supports = Supports(held=(40,), introducer=Introducer((0.0, 0.0, 0.0), (0.025, 0.0, 0.0)))
    integrator, state = ImplicitIntegrator(properties, supports), straight_rod(properties, (-0.041, 0, 0), X)
    start_m, iterations = state.position_m[40].copy(), []
    for share in np.linspace(0.0, 1.0, 400):
        integrator.held_target_m[0] = start_m + np.array([-0.01 * min(share, 0.5), 0.03 * share, 0.0])
        integrator.predict(state, np.zeros((51, 3)), 1e-3)
        iterations.append(integrator.iterations)
    assert max(iterations) < integrator.max_iterations
