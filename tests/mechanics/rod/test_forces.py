"""Forces against the numerical gradient of the energy, and the invariants of forces and damping."""

import numpy as np
import pytest

from trocar.services.mechanics.rod import (
    ImplicitIntegrator,
    Introducer,
    RodState,
    Supports,
    initial_frame,
    rod_energy,
    roll,
)
from trocar.services.mechanics.rod.forces import add_internal_forces
from trocar.services.mechanics.rod.model import allocate_work, build_model
from trocar.services.mechanics.rod.twist import (
    add_frame_forces,
    build_twist_model,
    frame_task,
    twist_energy,
    update_frame,
)
from trocar.studies.published.rods import example_rod

N = 10


def bent_chain(seed=0, scatter=0.4):
    """Particles of a rod of N segments in no special configuration, edges stretched and bent by `scatter`."""
    rng = np.random.default_rng(seed)
    edges = (rng.normal(size=(N, 3)) * scatter + [1.0, 0.0, 0.0]) * 0.1 / N
    return np.concatenate((np.zeros((1, 3)), np.cumsum(edges, axis=0)))


def forces(model, position, velocity=None, scale=(0.0, 0.0)):
    work = allocate_work(len(position))
    work.position[:] = position
    if velocity is not None:
        work.lead[0] = model.beta * velocity
    add_internal_forces(model, work, scale)
    return work


def numerical_gradient(energy, position, h=1e-8):
    gradient = np.zeros_like(position)
    for index in np.ndindex(position.shape):
        ends = []
        for sign in (1.0, -1.0):
            moved = position.copy()
            moved[index] += sign * h
            ends.append(energy(moved))
        gradient[index] = (ends[0] - ends[1]) / (2.0 * h)
    return gradient


@pytest.mark.parametrize(
    "supports",
    [
        Supports(),
        Supports(start_direction=(1, 0.3, 0), end_direction=(0.5, 0, 1)),
        Supports(introducer=Introducer((0.021, 0.001, 0), (0.062, 0.002, 0.003), lateral_stiffness_n_m=500.0)),
    ],
    ids=["free", "clamped ends", "introducer"],
)
def test_force_is_the_gradient_of_the_energy(supports):
    model = build_model(example_rod(N), supports)
    position = bent_chain()
    expected = -numerical_gradient(lambda x: rod_energy(model, RodState(x, 0 * x)).total_j, position)
    actual = forces(model, position).force
    np.testing.assert_allclose(actual, expected, rtol=0, atol=1e-6 * np.abs(expected).max())


def test_bending_force_is_the_gradient_of_the_energy_where_stretch_does_not_drown_it():
    model = build_model(example_rod(N, axial_stiffness_n=1e-3), Supports())
    position = bent_chain()
    expected = -numerical_gradient(lambda x: rod_energy(model, RodState(x, 0 * x)).total_j, position)
    np.testing.assert_allclose(forces(model, position).force, expected, rtol=0, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize("stretch", [1.0, 1.05])
def test_tangent_of_a_straight_rod_is_its_stiffness(stretch):
    model = build_model(example_rod(N), Supports(start_direction=(1, 0, 0)))
    position = np.zeros((N + 1, 3))
    position[:, 0] = np.linspace(0.0, 0.1 * stretch, N + 1)
    stiffness = dense(forces(model, position, scale=(1.0, 1.0)).band)
    expected = np.stack(
        [
            -(forces(model, position + h).force - forces(model, position - h).force).ravel() / 2e-9
            for h in 1e-9 * np.eye(3 * N + 3).reshape(-1, N + 1, 3)
        ]
    )
    np.testing.assert_allclose(stiffness, expected, rtol=0, atol=1e-5 * np.abs(expected).max())


@pytest.mark.parametrize("seed", range(5))
def test_tangent_is_positive_semidefinite_in_any_configuration(seed):
    introducer = Introducer((0.021, 0.001, 0), (0.062, 0.002, 0.003))
    model = build_model(example_rod(N), Supports(start_direction=(1, 0, 0), introducer=introducer))
    eigenvalues = np.linalg.eigvalsh(dense(forces(model, bent_chain(seed, 1.5), scale=(1.0, 1.0)).band))
    assert eigenvalues.min() > -1e-9 * eigenvalues.max()


def dense(band):
    n = len(band) - 8
    full = np.zeros((n, n))
    for a in range(9):
        full += np.diag(band[: n - a, a], -a)
        if a:
            full += np.diag(band[: n - a, a], a)
    return full


@pytest.mark.parametrize("beta", [0.0, 1e-3])
def test_internal_forces_have_no_resultant_and_no_moment(beta):
    model = build_model(example_rod(N, internal_damping_s=beta), Supports())
    position = bent_chain()
    velocity = np.random.default_rng(1).normal(size=position.shape)
    force = forces(model, position, velocity).force
    scale = np.abs(force).max()
    assert np.abs(force.sum(axis=0)).max() < 1e-12 * scale
    assert np.abs(np.cross(position, force).sum(axis=0)).max() < 1e-12 * scale * 0.1


def test_damping_leaves_rigid_motion_alone_and_takes_energy_from_any_other():
    position = bent_chain()
    undamped = forces(build_model(example_rod(N), Supports()), position).force
    model = build_model(example_rod(N, internal_damping_s=1e-3), Supports())

    def damping(velocity):
        return forces(model, position, velocity).force - undamped

    rigid = np.array([0.3, -0.2, 0.5]) + np.cross([3.0, -7.0, 5.0], position)
    other = np.random.default_rng(2).normal(size=position.shape)
    assert np.abs(damping(rigid)).max() < 1e-10 * np.abs(damping(other)).max()
    assert np.sum(damping(other) * other) < 0.0


def test_a_straight_rod_is_damped_alike_in_every_plane():
    model = build_model(example_rod(N, internal_damping_s=1e-3), Supports())
    position = np.zeros((N + 1, 3))
    position[:, 0] = np.linspace(0.0, 0.1, N + 1)
    shape = np.sin(np.linspace(0.0, np.pi, N + 1))
    power = []
    for plane in ([0, 1, 0], [0, 0, 1], [0, 0.6, 0.8]):
        velocity = shape[:, None] * np.array(plane)
        power.append(np.sum(forces(model, position, velocity).force * velocity))
    assert power[0] < 0.0
    np.testing.assert_allclose(power, power[0], rtol=1e-9)


@pytest.mark.parametrize("clamps", [Supports(), Supports(start_direction=(1, 0, 0), end_direction=(0.6, 0.8, 0.0))])
def test_twist_and_rest_curvature_forces_are_the_gradient_at_equilibrium_angles(clamps):
    walls = clamps.wall_directions()
    rng = np.random.default_rng(3)
    properties = example_rod(N, torsional_stiffness_n_m2=17e-6, rest_curvature_1_m=rng.normal(size=(N - 1, 3)) * 15.0)
    twist = build_twist_model(properties, walls)
    state = RodState(bent_chain(), np.zeros((N + 1, 3)), initial_frame(bent_chain(), walls=walls))
    state.frame.end_is_held = True
    roll(state.frame, -1, 4.0)
    force = np.zeros((N + 1, 3))
    for _ in range(30):
        force[:] = 0.0
        add_frame_forces(twist, state, force)

    def relaxed_energy(position):
        moved = RodState(position, state.velocity_m_s, state.frame.copy())
        for _ in range(4):
            add_frame_forces(twist, moved, np.zeros_like(force))
        return twist_energy(twist, moved)

    expected = -numerical_gradient(relaxed_energy, state.position_m, h=1e-6)
    np.testing.assert_allclose(force, expected, rtol=0, atol=1e-5 * np.abs(expected).max())
    assert np.abs(force.sum(axis=0)).max() < 1e-12 * np.abs(force).max()


@pytest.fixture(scope="module")
def damping_of_curved_rod():
    """Return a curved rod's positions at rest, and its damping forces there as a function of velocities."""
    rng, beta, dt_s = np.random.default_rng(4), 1e-3, 1e-10  # in so short a step the elastic moments change by nothing
    curvature = rng.normal(size=(N - 1, 3)) * 15.0
    rod = example_rod(N, torsional_stiffness_n_m2=17e-6, rest_curvature_1_m=curvature, internal_damping_s=beta)
    integrator, position = ImplicitIntegrator(rod), bent_chain()
    rest, work = RodState(position, np.zeros_like(position), initial_frame(position)), integrator.work
    for _ in range(30):
        add_frame_forces(integrator.twist, rest, np.zeros_like(position))

    def forces_at(velocity):
        force = np.zeros_like(position)
        update_frame(frame_task(integrator.twist, rest.copy()), (position, velocity), (dt_s, False), force)
        work.position[:], work.lead[0], work.force[:] = position, beta * velocity, 0.0
        add_internal_forces(integrator.model, work, (0.0, 0.0))
        return force + work.force

    return position, lambda velocity: 0.5 * (forces_at(velocity) - forces_at(-velocity))


def test_damping_in_the_material_leaves_rigid_motion_alone(damping_of_curved_rod):
    """About an axis normal to the first director's tangent, as the roll of that director is prescribed."""
    position, damping = damping_of_curved_rod
    first, other = position[1] - position[0], np.random.default_rng(5).normal(size=position.shape)
    for axis in np.eye(3):
        rigid = np.array([0.3, -0.2, 0.5]) + np.cross(5.0 * np.cross(first / np.linalg.norm(first), axis), position)
        assert np.abs(damping(rigid)).max() < 1e-7 * np.abs(damping(other)).max()


def test_damping_in_the_material_follows_from_a_potential_and_takes_energy(damping_of_curved_rod):
    position, damping = damping_of_curved_rod
    rng = np.random.default_rng(6)
    for _ in range(20):
        u, v = rng.normal(size=(2, *position.shape))
        here, there = damping(u), damping(v)
        assert np.sum(here * u) < 0.0
        assert np.sum(there * u) == pytest.approx(np.sum(here * v), rel=1e-6)
