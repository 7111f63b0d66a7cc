"""What a contact solver relies on: predict, then compliance or solve, then correct."""

import numpy as np
import pytest

from trocar.services.mechanics.rod import (
    ImplicitIntegrator,
    Supports,
    build_integrator,
    clamped,
    rod_energy,
    straight_rod,
)
from trocar.studies.published.rods import example_rod

DT_S = 1e-3


def bent(integrator_name):
    properties = example_rod(internal_damping_s=1e-3 if integrator_name == "implicit" else 0.0)
    integrator = build_integrator(integrator_name, properties, Supports(held=(0, 7), start_direction=(1, 0, 0)))
    state = straight_rod(properties, (0, 0, 0), (1, 0, 0))
    load = np.zeros((51, 3))
    load[-1] = [0.0, 0.01, -0.03]
    for _ in range(50):
        integrator.predict(state, load, DT_S)
    return integrator, state, load


@pytest.fixture(params=["implicit", "semi_implicit"])
def stepped(request):
    """An integrator after a step, the state before and after it, and the load."""
    integrator, before, load = bent(request.param)
    after = before.copy()
    integrator.predict(after, load, DT_S)
    return integrator, before, after, load


def test_compliance_is_the_position_change_that_correct_makes(stepped):
    integrator, _, after, _ = stepped
    particles = np.array([0, 3, 7, 8, 30, 31, 32, 50], dtype=np.int32)
    compliance = np.empty((24, 24))
    integrator.compliance(particles, compliance)
    for k, particle in enumerate(particles):
        force = np.zeros((51, 3))
        force[particle] = [1.0, -2.0, 0.5]
        moved = after.copy()
        integrator.correct(moved, force)
        change = (moved.position_m - after.position_m)[particles].ravel()
        expected = compliance[:, 3 * k : 3 * k + 3] @ force[particle]
        np.testing.assert_allclose(change, expected, rtol=1e-9, atol=1e-12 * np.abs(compliance).max())
    np.testing.assert_array_equal(compliance, compliance.T)
    assert not compliance[:3].any()
    assert not compliance[6:9].any()


def test_solve_gives_the_same_changes_for_many_right_hand_sides(stepped):
    integrator, _, after, _ = stepped
    forces = np.random.default_rng(0).normal(size=(51, 3, 11))
    changes = np.empty_like(forces)
    integrator.solve(forces, changes)
    for m in range(11):
        moved = after.copy()
        integrator.correct(moved, np.ascontiguousarray(forces[:, :, m]))
        # the moved positions carry rounding of the positions themselves
        np.testing.assert_allclose(moved.position_m - after.position_m, changes[:, :, m], rtol=1e-7, atol=1e-15)


def test_gains_relate_velocity_and_position_changes(stepped):
    integrator, _, after, _ = stepped
    force = np.random.default_rng(1).normal(size=(51, 3)) * 1e-2
    moved = after.copy()
    integrator.correct(moved, force)
    ratio = integrator.velocity_gain_s / integrator.position_gain_s2
    np.testing.assert_allclose(
        moved.velocity_m_s - after.velocity_m_s, ratio * (moved.position_m - after.position_m), rtol=1e-6, atol=1e-10
    )


@pytest.mark.parametrize("spectral_radius", [1.0, 0.6, 0.0])
@pytest.mark.parametrize("touched", [[50], [25, 40, 50], list(range(10, 51, 4))])
def test_a_rod_laid_on_points_comes_to_rest_on_them_at_once_with_the_forces_of_its_load(spectral_radius, touched):
    """Frictionless points under a rod with weight, kept at their height by the forces that the compliance tells."""
    properties = example_rod(internal_damping_s=2e-4)
    integrator = ImplicitIntegrator(properties, clamped((1, 0, 0)), spectral_radius=spectral_radius)
    state = straight_rod(properties, (0, 0, 0), (1, 0, 0))
    state.velocity_m_s[1:, 2] = -0.05
    weight = properties.particle_mass_kg()[:, None] * np.array([0.0, 0.0, -9.81])
    contact, particles = np.zeros((51, 3)), np.array(touched, dtype=np.int32)
    compliance = np.empty((3 * len(touched), 3 * len(touched)))
    energy, supported = [np.inf], []
    for _ in range(300):
        integrator.predict(state, weight + contact, DT_S)
        integrator.correct(state, -contact)
        integrator.compliance(particles, compliance)
        contact[particles, 2] = np.linalg.solve(compliance[2::3, 2::3], -state.position_m[particles, 2])
        integrator.correct(state, contact)
        np.testing.assert_allclose(state.position_m[particles, 2], 0.0, rtol=0, atol=1e-12)
        energy.append(rod_energy(integrator.model, state).total_j - np.sum(weight * state.position_m))
        supported.append(contact[:, 2].sum())
    assert np.diff(energy[10:]).max() < 1e-3 * np.ptp(energy[1:])
    if len(touched) > 5:
        # The clamp carries three eighths of the first span's weight and what that span's beam makes of it.
        assert np.mean(supported[200:]) == pytest.approx(-weight[:, 2].sum(), rel=0.15)


def test_held_particles_reach_their_target_and_feel_no_contact(stepped):
    integrator, before, _, load = stepped
    target = before.position_m[7] + [1e-5, 2e-5, -1e-5]
    integrator.held_target_m[1] = target
    state = before.copy()
    integrator.predict(state, load, DT_S)
    integrator.correct(state, np.ones((51, 3)))
    np.testing.assert_allclose(state.position_m[7], target, rtol=0, atol=1e-15)
    np.testing.assert_allclose(state.position_m[0], before.position_m[0], rtol=0, atol=1e-15)


@pytest.mark.parametrize("integrator_name", ["implicit", "semi_implicit"])
@pytest.mark.parametrize("where", ["state", "force"])
def test_what_is_not_finite_is_reported(integrator_name, where):
    integrator, state, load = bent(integrator_name)
    (state.position_m if where == "state" else load)[12, 1] = np.nan
    with pytest.raises(FloatingPointError, match="not finite"):
        integrator.predict(state, load, DT_S)
