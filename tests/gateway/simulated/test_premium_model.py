from __future__ import annotations

import numpy as np
import pytest

from tests.gateway.simulated.arm_energy import energy_j
from trocar.services.gateway.simulated import premium_model
from trocar.services.gateway.simulated.premium_model import GEARS
from trocar.services.mechanics.arrays import FloatArray

POSTURES = [np.array(q) for q in ((0.0, 0.4, 0.4), (0.3, 0.9, 0.6), (-0.7, 0.2, 0.8), (0.5, -0.2, 0.3))]


def _forward(angles: FloatArray) -> FloatArray:
    out = np.zeros(3)
    premium_model.forward(angles, out)
    return out


@pytest.mark.parametrize("angles", POSTURES)
def test_inverse_undoes_forward(angles: FloatArray) -> None:
    np.testing.assert_allclose(premium_model.inverse(_forward(angles)), angles, atol=1e-12)


def test_a_point_beyond_both_links_is_refused() -> None:
    with pytest.raises(ValueError, match="does not reach 500 mm"):
        premium_model.inverse(np.array([0.5, 0.0, 0.0]))


@pytest.mark.parametrize("angles", POSTURES)
def test_jacobian_is_the_derivative_of_forward(angles: FloatArray) -> None:
    J = np.zeros((3, 3))
    premium_model.jacobian(angles, J)
    h = 1e-6
    difference = [(_forward(angles + h * e) - _forward(angles - h * e)) / (2 * h) for e in np.eye(3)]
    np.testing.assert_allclose(J, np.array(difference).T, atol=1e-9)


@pytest.mark.parametrize("angles", POSTURES)
def test_gravity_is_the_gradient_of_the_energy(angles: FloatArray) -> None:
    h, still = 1e-6, np.zeros(3)
    gradient = [(energy_j(angles + h * e, still) - energy_j(angles - h * e, still)) / (2 * h) for e in np.eye(3)]
    out = np.zeros(3)
    premium_model.accelerate(angles, still, np.array(gradient), out)
    np.testing.assert_allclose(out, 0.0, atol=1e-4)  # the torque that holds it leaves it at rest


def _drift(dt_s: float) -> float:
    """Return the largest relative energy error over half a second of free motion without friction."""
    angles, rates = np.array([0.0, 0.4, 0.4]), np.array([3.0, 1.0, -1.5])
    out = np.zeros(3)
    start = energy_j(angles, rates)
    worst = 0.0
    for _ in range(round(0.2 / dt_s)):
        premium_model.accelerate(angles, rates, np.zeros(3), out)
        rates += dt_s * out
        angles += dt_s * rates
        worst = max(worst, abs(energy_j(angles, rates) / start - 1.0))
    return worst


def test_energy_is_conserved_to_first_order_in_the_step() -> None:
    errors = [_drift(dt_s) for dt_s in (4e-4, 2e-4, 1e-4)]
    rates = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    np.testing.assert_allclose(rates, 1.0, atol=0.15)
    assert errors[-1] < 2e-3


def test_friction_and_stops_only_take_energy() -> None:
    rng = np.random.default_rng(2)
    for _ in range(200):
        angles = rng.uniform((-1.0, -0.3, 0.0), (1.0, 0.9, 0.6))
        rates = 3.0 * rng.standard_normal(3)
        for joint in range(3):
            assert premium_model.passive_torque(angles, rates, joint) * rates[joint] < 0.0


def test_dry_friction_only_takes_energy_and_stops_what_it_can() -> None:
    rng, dt = np.random.default_rng(3), 1.25e-4
    stopped = 0
    for scale in np.geomspace(1e-4, 3.0, 300):
        angles = rng.uniform((-1.0, -0.3, 0.0), (1.0, 0.9, 0.6))
        before = scale * rng.standard_normal(3)
        rates = before.copy()
        premium_model.rub(angles, rates, dt)
        m11, m22, m23, m33 = premium_model.mass(angles)
        M = np.array([[m11, 0, 0], [0, m22, m23], [0, m23, m33]])
        impulse = M @ (rates - before)
        assert rates @ M @ rates <= before @ M @ before
        assert np.abs(impulse).max() <= premium_model.COULOMB * dt * (1.0 + 1e-3)
        slides = rates != 0.0
        np.testing.assert_allclose(impulse[slides], -premium_model.COULOMB * dt * np.sign(rates[slides]), rtol=1e-3)
        stopped += int(np.sum(~slides))
    assert 50 < stopped < 850


def test_stall_torque_gives_the_data_sheets_force() -> None:
    # 8.5 N: motor stall through the gear at the end of the second link.
    assert 0.129 * GEARS[2] / premium_model.L2 == pytest.approx(8.5, rel=0.01)


def test_apparent_mass_at_the_centre_is_below_the_data_sheets() -> None:
    angles = np.array(premium_model.CENTRE_ANGLES)
    J = np.zeros((3, 3))
    premium_model.jacobian(angles, J)
    m11, m22, m23, m33 = premium_model.mass(angles)
    M = np.array([[m11, 0, 0], [0, m22, m23], [0, m23, m33]])
    apparent = 1.0 / np.diag(J @ np.linalg.inv(M) @ J.T)
    assert 0.03 < apparent.min() <= apparent.max() < 0.075  # 75 g with the gimbal, which the model leaves out
