"""Torsion, rest curvature and twist buckling."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from trocar.services.mechanics.rod import (
    ImplicitIntegrator,
    RodState,
    RoundTube,
    Supports,
    build_integrator,
    clamped,
    initial_frame,
    rod_energy,
    roll,
    straight_rod,
)
from trocar.services.mechanics.rod.twist import add_frame_forces
from trocar.studies.published.rods import (
    EI,
    GJ,
    LENGTH_M,
    X,
    critical_torque_factor,
    example_rod,
    mode_frequency_rad_s,
    mode_shape,
    step_to_rest,
    twisted_rod,
)

NO_LOAD = np.zeros((51, 3))
DAMPED = {"torsional_stiffness_n_m2": GJ, "internal_damping_s": 5e-3, "viscous_drag_n_s_m2": 0.05}

PAGE = Path(__file__).parents[3] / "docs" / "results" / "verification.md"


def test_a_rod_without_torsional_stiffness_has_no_frame():
    integrator = ImplicitIntegrator(example_rod())
    state = straight_rod(example_rod(), (0, 0, 0), X)
    integrator.predict(state, NO_LOAD, 1e-3)
    assert integrator.twist is None
    assert state.frame is None


@pytest.mark.parametrize("angle_rad", [0.3, -2.0, 25.0])
@pytest.mark.parametrize(
    ("supports", "between_grips"),
    [
        (Supports(held=(0, -1)), 49 / 50),
        (clamped(X), 49.5 / 50),
        (Supports(held=(-1,), end_direction=X), 49.5 / 50),
        (Supports(held=(0, -1), start_direction=X, end_direction=X), 1.0),
    ],
    ids=["two segments", "clamp and segment", "segment and clamp", "two clamps"],
)
def test_torque_is_GJ_phi_over_the_length_between_the_grips(angle_rad, supports, between_grips):
    """A clamp grips the end of the rod, a grip without one the middle of the segment there."""
    integrator, state = twisted_rod(angle_rad, supports, bending_stiffness_n_m2=1.0)  # too stiff to buckle
    integrator.predict(state, NO_LOAD, 1e-3)
    torque = integrator.twist.torsion * state.frame.twist_rad
    np.testing.assert_allclose(torque, GJ * angle_rad / (LENGTH_M * between_grips), rtol=1e-9)


def test_a_frame_without_the_directors_of_its_clamps_is_refused():
    integrator, state = twisted_rod(1.0)
    state.frame = initial_frame(state.position_m)
    with pytest.raises(ValueError, match="50 directors, not 52"):
        integrator.predict(state, NO_LOAD, 1e-3)


@pytest.mark.parametrize(("n_segments", "within"), [(16, 2e-3), (32, 5e-4)])
def test_a_curved_cantilever_gives_way_out_of_its_plane_by_bending_and_twist(n_segments, within):
    """A quarter circle under a tip load along its axis: P R^3 (pi/4 / EI + (3 pi/4 - 2) / GJ); of second order."""
    radius_m, load_n = LENGTH_M / (0.5 * np.pi), 1e-5
    curvature = np.zeros((n_segments - 1, 3))
    curvature[:, 0] = 1.0 / radius_m
    properties = example_rod(n_segments, **DAMPED, axial_stiffness_n=1e3, rest_curvature_1_m=curvature)
    angle = 0.5 * np.pi * np.linspace(0.0, 1.0, n_segments + 1)
    arc = radius_m * np.stack([np.sin(angle), 0.0 * angle, np.cos(angle) - 1.0], axis=1)
    supports = clamped(X)
    state = RodState(arc, np.zeros_like(arc), initial_frame(arc, (0.0, 1.0, 0.0), supports.wall_directions()))
    integrator, load = ImplicitIntegrator(properties, supports), np.zeros_like(arc)
    tip_m = []
    for load[-1, 1] in (-load_n, load_n):
        step_to_rest(integrator, state, load, speed_m_s=1e-9)
        tip_m.append(state.position_m[-1, 1])
    expected_m = load_n * radius_m**3 * (np.pi / 4.0 / EI + (3.0 * np.pi / 4.0 - 2.0) / GJ)
    assert 0.5 * (tip_m[1] - tip_m[0]) == pytest.approx(expected_m, rel=within)


def test_a_free_end_unwinds_at_once():
    integrator, state = twisted_rod(5.0)
    state.frame.end_is_held = False
    integrator.predict(state, NO_LOAD, 1e-3)
    np.testing.assert_allclose(state.frame.twist_rad, 0.0, atol=1e-12)


def test_torsion_between_different_stiffnesses_divides_as_springs_in_series():
    stiffness = np.full(50, GJ)
    stiffness[25:] = 0.25 * GJ
    integrator, state = twisted_rod(1.0, torsional_stiffness_n_m2=stiffness, bending_stiffness_n_m2=1.0)
    integrator.predict(state, NO_LOAD, 1e-3)
    torque = integrator.twist.torsion * state.frame.twist_rad
    half = 0.5 * LENGTH_M
    np.testing.assert_allclose(torque, 1.0 / (half / GJ + half / (0.25 * GJ)), rtol=1e-9)


def test_a_clamped_rod_buckles_under_torque_where_half_its_angle_equals_its_tangent():
    # straight rod, both ends clamped, no thrust: tan(M L / 2 EI) = M L / 2 EI, so M L / EI = 8.9868
    factor = critical_torque_factor()
    assert factor == pytest.approx(8.9868, rel=0.01)
    told = re.search(r"^\| twist buckling.* \| ([+-][\d.]+) \|$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert told is not None
    assert float(told[1]) == pytest.approx(100.0 * (factor / 8.9868 - 1.0), abs=0.011), "benchmarks/verification.py"


def test_a_rod_of_uniform_rest_curvature_becomes_a_circle_of_its_radius():
    curvature = np.zeros((49, 3))
    curvature[:, 0] = 30.0
    properties = example_rod(**DAMPED, rest_curvature_1_m=curvature)
    integrator = ImplicitIntegrator(properties)
    state = straight_rod(properties, (0, 0, 0), X)
    for _ in range(3000):
        integrator.predict(state, NO_LOAD, 1e-3)
    edge = np.diff(state.position_m, axis=0)
    angle = np.arccos(np.sum(edge[1:] * edge[:-1], axis=1) / properties.segment_length_m**2)
    np.testing.assert_allclose(angle / properties.segment_length_m, 30.0, rtol=1e-3)
    assert np.linalg.svd(state.position_m - state.position_m.mean(axis=0))[1][2] < 1e-6
    energy = rod_energy(integrator.model, state, integrator.twist)
    assert energy.bending_j > 1e-3
    assert energy.total_j == pytest.approx(0.0, abs=1e-9 * energy.bending_j)  # nothing is strained


def test_rest_curvature_and_twist_make_a_helix():
    kappa, tau = 40.0, 25.0
    properties = example_rod(**DAMPED, rest_curvature_1_m=np.tile([kappa, 0.0, tau], (49, 1)))
    integrator = ImplicitIntegrator(properties)
    state = straight_rod(properties, (0, 0, 0), X)
    for _ in range(4000):
        integrator.predict(state, NO_LOAD, 1e-3)
    t = np.diff(state.position_m, axis=0) / properties.segment_length_m
    binormal = np.cross(t[:-1], t[1:])
    curvature = np.arcsin(np.linalg.norm(binormal, axis=1)) / properties.segment_length_m
    binormal /= np.linalg.norm(binormal, axis=1)[:, None]
    turn = np.arcsin(np.einsum("ij,ij->i", np.cross(binormal[:-1], binormal[1:]), t[1:-1]))
    inner = slice(5, -5)
    np.testing.assert_allclose(curvature[inner], kappa, rtol=0.01)
    np.testing.assert_allclose(turn[inner] / properties.segment_length_m, tau, rtol=0.01)


@pytest.mark.parametrize("integrator_name", ["implicit", "semi_implicit"])
def test_rolling_the_grip_turns_a_bent_tip_about_the_axis(integrator_name):
    curvature = np.zeros((49, 3))
    curvature[-8:, 0] = 60.0
    damping = {"viscous_drag_n_s_m2": 0.3, "axial_stiffness_n": 5.0, "torsional_stiffness_n_m2": GJ}
    properties = example_rod(**damping, rest_curvature_1_m=curvature)
    integrator = build_integrator(integrator_name, properties, clamped(X))
    state = straight_rod(properties, (0, 0, 0), X)
    state.frame = initial_frame(state.position_m, (0.0, 1.0, 0.0), clamped(X).wall_directions())
    directions = []
    for turn in range(2):
        if turn:
            for _ in range(100):
                roll(state.frame, 0, np.pi / 200.0)
                integrator.predict(state, NO_LOAD, 1e-3)
        for _ in range(400):
            integrator.predict(state, NO_LOAD, 1e-3)
        tip = state.position_m[-1, 1:] - state.position_m[-12, 1:]
        assert np.linalg.norm(tip) > 3e-3
        directions.append(tip / np.linalg.norm(tip))
    # bent about m1 = y: towards -z; after a quarter turn about x: towards +y
    np.testing.assert_allclose(directions[0], [0.0, -1.0], atol=1e-3)
    np.testing.assert_allclose(directions[1], [1.0, 0.0], atol=0.02)


@pytest.mark.parametrize("dt_s", [1e-3, 0.25e-3])
@pytest.mark.parametrize("youngs_modulus_pa", [50e9, 200e9])
@pytest.mark.parametrize(("length_m", "bent_m", "curvature_1_m"), [(60e-3, 14e-3, 80.0), (30e-3, 20e-3, 100.0)])
def test_a_bent_tip_whose_grip_has_turned_comes_to_rest(youngs_modulus_pa, length_m, bent_m, curvature_1_m, dt_s):
    """A wire of 0.9 mm, hardly damped: a step that is not as stiff as its twist makes it flutter at 0.1 m/s.

    In short steps, without damping out of the planes of its joints, it still swings at 1 cm/s.
    """
    n, step_m = 30, length_m / 30
    curvature = np.zeros((n - 1, 3))
    curvature[-int(bent_m / step_m) :, 0] = curvature_1_m
    wire = RoundTube(0.9e-3, 0.0, youngs_modulus_pa, 6450.0, 0.33).rod(n, length_m, twist=True, internal_damping_s=2e-3)
    properties = replace(wire, rest_curvature_1_m=curvature)
    turned = np.concatenate([[0.0], np.cumsum(curvature[:, 0]) * step_m])
    edges = step_m * np.stack([np.cos(turned), np.sin(turned), np.zeros(n)], axis=1)
    position_m = np.concatenate([np.zeros((1, 3)), np.cumsum(edges, axis=0)])
    frame = initial_frame(position_m, (0.0, 0.0, 1.0), clamped(X).wall_directions())
    state, integrator = (
        RodState(position_m, np.zeros_like(position_m), frame),
        ImplicitIntegrator(properties, clamped(X)),
    )
    roll(state.frame, 0, 0.1)
    for _ in range(round(0.6 / dt_s)):
        integrator.predict(state, np.zeros_like(position_m), dt_s)
    assert np.abs(state.velocity_m_s).max() < 1e-9


def hook(youngs_modulus_pa, curvature_1_m, damping_s=2e-4, drag_n_s_m2=0.05):
    """Return a straight rod of 60 segments whose last seven are curved at rest; moduli are those of shaft and tip."""
    n, (shaft_pa, tip_pa) = 60, youngs_modulus_pa
    damping = {"internal_damping_s": damping_s, "viscous_drag_n_s_m2": drag_n_s_m2}
    rod = RoundTube(1.6e-3, 0.0, shaft_pa, 1100.0, 0.45).rod(n, 0.12, twist=True, **damping)
    curvature, softness = np.zeros((n - 1, 3)), np.ones(n)
    curvature[-7:, 0], softness[-7:] = curvature_1_m, tip_pa / shaft_pa
    names = "axial_stiffness_n", "bending_stiffness_n_m2", "torsional_stiffness_n_m2"
    return replace(rod, rest_curvature_1_m=curvature, **{name: softness * getattr(rod, name) for name in names})


@pytest.mark.parametrize(
    ("tip_pa", "curvature_1_m", "dt_s"),
    [(3e6, 300.0, 1e-3), (3e6, 150.0, 2e-3), (1e6, 300.0, 2e-3), (10e6, 300.0, 1e-3)],
)
def test_a_curved_tip_that_was_pushed_aside_comes_to_rest(tip_pa, curvature_1_m, dt_s):
    """Soft tips ring at 0.01 to 0.3 m/s for ever if the frame's forces are taken elsewhere than the other forces.

    That of 10 MPa still moves at 0.02 mm/s if the step is taken once, with the directors where the velocities lead.
    """
    properties = hook((30e6, tip_pa), curvature_1_m)
    integrator, state = ImplicitIntegrator(properties, clamped(X)), straight_rod(properties, (0, 0, 0), X)
    weight_n = np.zeros_like(state.position_m)
    weight_n[:, 2] = -9.81 * properties.particle_mass_kg()
    pushed_n, full = weight_n.copy(), integrator.twist.rest_rotation.copy()
    pushed_n[-1] += 0.0, 0.002, 0.003
    for k in range(round(2.5 / dt_s)):
        integrator.twist.rest_rotation[:] = full * min(k * dt_s / 0.5, 1.0)  # as a handle steers it
        integrator.predict(state, pushed_n if 0.5 <= k * dt_s < 0.55 else weight_n, dt_s)
    assert np.abs(state.velocity_m_s).max() < 1e-6


def test_an_undamped_curved_tip_keeps_its_energy():
    """It gains several times its energy in a second if the frame's forces are taken elsewhere than the other forces."""
    damped, moduli = hook((30e6, 3e6), 300.0, drag_n_s_m2=2.0), (30e6, 3e6)
    state, none_n = straight_rod(damped, (0, 0, 0), X), np.zeros((61, 3))
    integrator = ImplicitIntegrator(damped, clamped(X))
    for _ in range(2000):
        integrator.predict(state, none_n, 1e-3)
    integrator = ImplicitIntegrator(hook(moduli, 300.0, 0.0, 0.0), clamped(X), spectral_radius=1.0)
    state.halt()
    state.velocity_m_s += np.linspace(0.0, 1.0, 61)[:, None] ** 2 * (0.0, 0.02, 0.03)
    energy_j = []
    for _ in range(1000):
        now = state.copy()
        add_frame_forces(integrator.twist, now, none_n.copy())
        energy_j.append(rod_energy(integrator.model, now, integrator.twist).total_j)
        integrator.predict(state, none_n, 1e-3)
    assert np.abs(np.array(energy_j) / energy_j[0] - 1.0).max() < 0.03


def test_a_swing_in_a_circle_decays_as_one_in_a_plane():
    """At beta omega^2/2: the angles of joints do not change in it, but the curvature of the material turns.

    The half joint in the wall, with 4 % of the energy, is damped in its plane only.
    """
    beta_s, omega_rad_s, shape = 2e-3, mode_frequency_rad_s(0), mode_shape(0)
    rod = example_rod(torsional_stiffness_n_m2=GJ, internal_damping_s=beta_s)
    integrator, state = ImplicitIntegrator(rod, clamped(X), spectral_radius=1.0), straight_rod(rod, (0, 0, 0), X)
    state.position_m[:, 1], state.velocity_m_s[:, 2] = 1e-5 * shape, 1e-5 * omega_rad_s * shape
    radius_m = []
    for _ in range(1000):
        integrator.predict(state, NO_LOAD, 0.5e-3)
        radius_m.append(np.linalg.norm(state.position_m[-1, 1:]))
    rate_1_s = np.log(radius_m[199] / radius_m[999]) / 0.4
    assert rate_1_s == pytest.approx(0.5 * beta_s * omega_rad_s**2, rel=0.05)


def test_a_copy_of_a_state_shares_nothing():
    _, state = twisted_rod(1.0)
    copy = state.copy()
    roll(state.frame, 0, 0.5)
    state.position_m += 1.0
    assert copy.frame.twist_rad[0] == 0.0
    assert copy.position_m.max() == pytest.approx(0.1)
