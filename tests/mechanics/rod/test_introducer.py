"""The introducer."""

import numpy as np
import pytest

from services.mechanics.rod import (
    ImplicitIntegrator,
    Introducer,
    SemiImplicitIntegrator,
    Supports,
    rod_along,
    rod_energy,
    straight_rod,
)
from services.mechanics.rod.energy import internal_forces
from services.mechanics.rod.model import build_model
from services.studies.rod_problems import EA, EI, example_rod

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


def test_thrust_through_the_introducer_is_mu_times_the_pushes_of_its_wall():
    """A cross load at the tip presses the rod to the wall near the exit, up and down; pushing it on takes their sum."""
    properties = example_rod(viscous_drag_n_s_m2=0.05, internal_damping_s=5e-3)
    introducer = Introducer(*INTRODUCER, friction=0.2)
    integrator, state = in_introducer(properties, Supports(held=(0,), start_direction=X, introducer=introducer))
    load = np.zeros((51, 3))
    load[-1, 2] = -2e-3
    push(integrator, state, load, 0.0, 1500)
    push(integrator, state, load, 0.02, 300)
    thrust, pushes = [], []
    for _ in range(200):  # two segments long: the pushes change as particles pass the exit
        push(integrator, state, load, 0.02, 1)
        strain = np.linalg.norm(np.diff(state.position_m, axis=0), axis=1) / properties.segment_length_m - 1.0
        thrust.append(-EA * strain[5] - 0.05 * 0.02 * 0.1)  # less the viscous drag of the rod
        pushes.append(wall_pushes(state.position_m, introducer.lateral_stiffness_n_m))
    assert np.mean(thrust) == pytest.approx(0.2 * np.mean(pushes), rel=0.05)
    assert np.mean(pushes) > 0.05


def wall_pushes(position, stiffness_n_m):
    """Sum of the wall's push magnitudes on a rod in INTRODUCER, from how far it stands off the axis."""
    x, off = position[:, 0], np.linalg.norm(position[:, 1:], axis=1)
    inside = (x > 0.0) & (x < 0.03)
    depth = np.minimum(x, 0.03 - x)[inside]
    total = np.sum(np.minimum(depth / 0.002, 1.0) * off[inside])
    for plane in (0.0, 0.03):
        total += np.linalg.norm([np.interp(plane, x, position[:, axis]) for axis in (1, 2)])
    return stiffness_n_m * total


def test_explicit_friction_brings_the_rod_to_rest_without_feeding_it():
    properties = example_rod()
    introducer = Introducer(*INTRODUCER, lateral_stiffness_n_m=1e4, friction=0.5)
    integrator, state = in_introducer(properties, Supports(introducer=introducer), SemiImplicitIntegrator)
    load = np.zeros((51, 3))
    load[22, 2], load[28, 2] = 0.05, -0.05
    state.velocity_m_s[:, 0] = 0.05
    speed = [0.05]
    for _ in range(60):
        integrator.predict(state, load, 1e-3)
        mass = properties.particle_mass_kg()
        speed.append(abs(mass @ state.velocity_m_s[:, 0]) / mass.sum())
    assert max(speed) == speed[0]
    assert max(speed[30:]) < 0.02 * speed[0]


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
            # the particle that stops is the first one at least 5 mm from the tip: 6 mm
            assert axial(state, 50 - 3) == pytest.approx(0.03 - give_m, rel=1e-4)


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


def test_pulling_through_a_seal_takes_its_friction_and_a_smaller_pull_does_not_move_the_rod():
    """Under tension too: the speed that friction follows is the rod's own, not that of a step's first guess."""
    properties = example_rod(viscous_drag_n_s_m2=0.0, internal_damping_s=5e-3)
    introducer = Introducer(*INTRODUCER, seal_friction_n=0.2)
    integrator, state = in_introducer(properties, Supports(held=(-1,), introducer=introducer))
    tension = []
    for _ in range(400):
        integrator.held_target_m[0] = state.position_m[-1] + np.array([1e-5, 0.0, 0.0])
        integrator.predict(state, np.zeros((51, 3)), 1e-3)
        strain = np.linalg.norm(np.diff(state.position_m, axis=0), axis=1) / properties.segment_length_m - 1.0
        tension.append(EA * strain[-3])
    assert np.mean(tension[200:]) == pytest.approx(0.2, rel=0.02)
    assert np.std(tension[200:]) < 0.02
    integrator, state = in_introducer(properties, Supports(introducer=introducer))
    pull = np.zeros((51, 3))
    pull[-1, 0] = 0.1
    for _ in range(500):
        integrator.predict(state, pull, 1e-3)
    stretch_m = 0.1 * 0.03 / EA
    assert 0.0 < axial(state, -1) - 0.059 < 1.01 * stretch_m + 0.5 * introducer.slip_speed_m_s * 0.5


def test_friction_under_tension_follows_the_rods_own_speed():
    """A taut rod whose stretch grows: the step's first guess is that it stands still, friction is that of its slide."""
    properties = example_rod()
    seal_n = 2e-5  # takes 1 % of the rod's momentum in a step
    integrator, state = in_introducer(properties, Supports(introducer=Introducer(*INTRODUCER, seal_friction_n=seal_n)))
    state.position_m[:, 0] *= 1.0 + 0.5 / EA
    state.velocity_m_s[:, 0] = 0.01 + 1e-3 * np.linspace(0.0, 1.0, 51)
    pull = np.zeros((51, 3))
    pull[[0, -1], 0] = -0.5, 0.5
    before = properties.particle_mass_kg() @ state.velocity_m_s[:, 0]
    integrator.predict(state, pull, 1e-3)
    lost = before - properties.particle_mass_kg() @ state.velocity_m_s[:, 0]
    assert lost == pytest.approx(1e-3 * seal_n, rel=0.05)
