"""Euler loads and the shape after buckling."""

import numpy as np
import pytest
from scipy.special import ellipk

from services.mechanics.rod import ImplicitIntegrator, Supports, clamped, straight_rod

from .helpers import EA, EI, LENGTH_M, example_rod, settle

X = (1.0, 0.0, 0.0)


def tip_angle_under_thrust(ratio):
    """Settled tip angle of a clamped-free column pushed along its axis by `ratio` times its Euler load."""
    properties = example_rod(internal_damping_s=5e-3, viscous_drag_n_s_m2=0.05)
    state = straight_rod(properties, (0, 0, 0), X)
    state.position_m[:, 1] += 1e-3 * np.linspace(0.0, 1.0, 51) ** 2
    push = np.zeros((51, 3))
    push[-1, 0] = -ratio * np.pi**2 * EI / (2.0 * LENGTH_M) ** 2
    settle(ImplicitIntegrator(properties, clamped(X)), state, push, dt_s=5e-3, speed_m_s=1e-8)
    last = state.position_m[-1] - state.position_m[-2]
    return np.arctan2(last[1], last[0])


def test_a_column_stays_straight_below_the_euler_load_and_not_above():
    assert abs(tip_angle_under_thrust(0.99)) < 1e-4
    assert tip_angle_under_thrust(1.01) > 0.2  # the elastica gives 0.281 rad


@pytest.mark.parametrize("angle_deg", [40.0, 90.0])
def test_angle_after_buckling_is_that_of_the_elastica(angle_deg):
    # P/P_cr = (2 K(sin(a/2)) / pi)^2; scipy's K takes the squared modulus
    ratio = (2.0 * ellipk(np.sin(np.radians(angle_deg) / 2.0) ** 2) / np.pi) ** 2
    assert np.degrees(tip_angle_under_thrust(ratio)) == pytest.approx(angle_deg, rel=0.01)


@pytest.mark.parametrize(
    ("factor", "walls"),
    [(1.0, {}), (0.699, {"start_direction": X}), (0.5, {"start_direction": X, "end_direction": X})],
    ids=["pinned-pinned", "clamped-pinned", "clamped-clamped"],
)
def test_thrust_of_a_column_shortened_past_buckling_is_the_euler_load(factor, walls):
    properties = example_rod(internal_damping_s=5e-3, viscous_drag_n_s_m2=0.05)
    integrator = ImplicitIntegrator(properties, Supports(held=(0, 50), **walls))
    state = straight_rod(properties, (0, 0, 0), X)
    state.position_m[1:-1, 2] += 1e-4 * np.sin(np.linspace(0.0, np.pi, 51))[1:-1]
    euler = np.pi**2 * EI / (factor * LENGTH_M) ** 2
    # past the elastic shortening at the Euler load, by so little that the load after buckling has hardly grown
    integrator.held_target_m[1] = [LENGTH_M * (1.0 - euler / EA - 2e-4), 0.0, 0.0]
    settle(integrator, state, np.zeros((51, 3)), dt_s=5e-3, speed_m_s=1e-8)
    length = np.linalg.norm(np.diff(state.position_m, axis=0), axis=1)
    thrust = EA * (1.0 - length.mean() / properties.segment_length_m)
    assert thrust == pytest.approx(euler, rel=0.005)
