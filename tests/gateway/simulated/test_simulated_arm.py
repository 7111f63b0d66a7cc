from __future__ import annotations

import math

import numpy as np
import pytest
import scipy.signal

from tests.gateway.simulated.arm_energy import energy_j
from trocar.services.gateway.servo import velocity_filter
from trocar.services.gateway.servo.servo_arrays import READ_POSITION, READ_SIZE, READ_TEMPERATURE, READ_VELOCITY
from trocar.services.gateway.simulated import premium_model, simulated_arm
from trocar.services.gateway.simulated.simulated_arm import ArmState
from trocar.services.mechanics.arrays import FloatArray

CENTRE = premium_model.centre()
FREE = np.zeros(simulated_arm.HAND_SIZE)


def _arm() -> ArmState:
    return ArmState(np.array(premium_model.CENTRE_ANGLES), 100.0)


def _hand(stiffness: float, damping: float, grip: float = 50.0) -> FloatArray:
    hand = np.zeros(simulated_arm.HAND_SIZE)
    hand[simulated_arm.HAND_TARGET : simulated_arm.HAND_TARGET + 3] = CENTRE
    hand[simulated_arm.HAND_STIFFNESS :] = stiffness, damping, grip
    return hand


def _place(arm: ArmState) -> FloatArray:
    out = np.zeros(3)
    premium_model.forward(arm.angles, out)
    return out - CENTRE


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_held_arm_yields_by_force_over_stiffness(axis: int) -> None:
    arm, force, hand = _arm(), np.zeros(3), _hand(500.0, 5.0)
    for _ in range(2000):
        arm.step(force, hand)
    rest = _place(arm)
    force[axis] = 2.0
    for _ in range(3000):
        arm.step(force, hand)
    moved = _place(arm) - rest
    expected = np.zeros(3)
    expected[axis] = 2.0 / 500.0
    # Friction may hold back what 0.01 N m at 0.17 m can: 0.06 N, twice.
    np.testing.assert_allclose(moved, expected, atol=0.12 / 500.0)


def test_an_arm_that_friction_holds_does_not_creep() -> None:
    """Half of what friction can hold, for a second: not by 1e-15 m, so that no encoder toggles."""
    arm, force, hand = _arm(), np.zeros(3), _hand(500.0, 5.0)
    for _ in range(2000):
        arm.step(force, hand)
    rest = _place(arm)
    force[1] = 0.02
    for _ in range(1000):
        arm.step(force, hand)
    np.testing.assert_array_equal(_place(arm), rest)


def test_force_saturates_at_motor_stall() -> None:
    rates = []
    for force_n in (2.0, 4.0, 30.0, 60.0):
        arm = _arm()
        arm.step(np.array([0.0, force_n, 0.0]), FREE)
        rates.append(float(np.linalg.norm(arm.rates)))
    assert 0.0 < 1.5 * rates[0] < rates[1] < rates[2]
    assert rates[2] == rates[3]


def test_a_hand_lets_slip_what_its_grip_cannot_hold() -> None:
    pulls = []
    for reach_m, grip_n in ((0.1, 2.0), (0.05, 2.0), (0.1, 4.0)):  # 100 and 50 N, were it not for the grip
        arm, hand = _arm(), _hand(1000.0, 0.0, grip=grip_n)
        hand[simulated_arm.HAND_TARGET + 1] += reach_m
        arm.step(np.zeros(3), hand)
        pulls.append(arm.rates.copy())
    np.testing.assert_allclose(pulls[0], pulls[1], rtol=1e-3)
    assert np.linalg.norm(pulls[2]) > 1.5 * np.linalg.norm(pulls[0]) > 0.0


@pytest.mark.parametrize("joint", [0, 1, 2])
def test_encoders_round_down_to_their_counts(joint: int) -> None:
    count = 2 * math.pi / (simulated_arm.COUNTS * premium_model.GEARS[joint])
    lever = (premium_model.L1 * math.cos(0.4) + premium_model.L2 * math.sin(0.4), premium_model.L1, premium_model.L2)
    first = math.ceil(0.4 / count)
    seen = np.zeros((3, 3))
    for row, counts in enumerate((first + 0.01, first + 0.99, first + 1.01)):
        angles = np.array([0.0, 0.4, 0.4])
        angles[joint] = counts * count
        simulated_arm.measure(angles, seen[row])
    np.testing.assert_array_equal(seen[0], seen[1])
    assert np.linalg.norm(seen[2] - seen[0]) == pytest.approx(lever[joint] * count, rel=1e-3)
    assert 20e-6 < lever[joint] * count < 35e-6  # the data sheet's 0.03 mm


def test_measured_velocity_follows_a_steady_motion() -> None:
    arm, reading = _arm(), np.zeros(READ_SIZE)
    speed = 0.05
    hand = _hand(2000.0, 20.0)
    velocities = []
    for k in range(400):
        hand[simulated_arm.HAND_TARGET + 1] = speed * k * simulated_arm.TICK_S
        hand[simulated_arm.HAND_RATE + 1] = speed
        arm.step(np.zeros(3), hand)
        arm.read(CENTRE, reading)
        velocities.append(reading[READ_VELOCITY + 1])
    assert np.mean(velocities[200:]) == pytest.approx(speed, rel=0.02)
    np.testing.assert_allclose(reading[READ_POSITION : READ_POSITION + 3], _place(arm), atol=60e-6)


@pytest.mark.parametrize("cut_off_hz", [20.0, 100.0, 400.0])
def test_the_velocity_filter_is_scipys(cut_off_hz: float) -> None:
    b, a = scipy.signal.butter(2, cut_off_hz, fs=1.0 / simulated_arm.TICK_S)
    np.testing.assert_allclose(velocity_filter.butterworth(cut_off_hz), [*b, *a[1:]], rtol=1e-10)


def test_winding_comes_to_rest_at_its_limit_with_the_catalogues_current() -> None:
    # 1.24 A for ever makes 100 degrees in the catalogue; the two-node model needs 75 K / 17.1 K/W = 4.39 W.
    cold_w = 1.24**2 * simulated_arm.RESISTANCE_OHM
    rise_k_w = simulated_arm.WINDING_K_W + simulated_arm.HOUSING_K_W
    warmer_k = cold_w * rise_k_w / (1.0 - simulated_arm.COPPER_1_K * cold_w * rise_k_w)  # copper resists more when warm
    assert simulated_arm.ROOM_C + warmer_k == pytest.approx(100.0, abs=2.0)
    motor = np.full(3, 1.24 * simulated_arm.TORQUE_NM_A)
    housing_c = simulated_arm.ROOM_C + warmer_k * simulated_arm.HOUSING_K_W / rise_k_w
    for winding_off_k, housing_off_k in ((0.0, 0.0), (5.0, 0.0), (-5.0, 0.0), (0.0, 5.0), (0.0, -5.0)):
        off_k = np.array([[winding_off_k] * 3, [housing_off_k] * 3])
        rest = np.array([[simulated_arm.ROOM_C + warmer_k] * 3, [housing_c] * 3])
        heat = rest + off_k
        simulated_arm._warm(motor, heat)
        if not off_k.any():
            np.testing.assert_allclose(heat, rest, rtol=1e-12)
        assert (np.abs(heat - rest)[off_k != 0.0] < 5.0).all(), "back towards rest"


def test_temperature_is_told_as_a_share_of_the_limit() -> None:
    arm, reading = _arm(), np.zeros(READ_SIZE)
    arm.heat[0, 1] = 62.5
    arm.read(CENTRE, reading)
    assert reading[READ_TEMPERATURE] == pytest.approx(0.5)


def test_an_arm_without_a_hand_comes_to_rest_and_never_gains_energy() -> None:
    arm = _arm()
    arm.rates[:] = 2.0, 0.5, -0.5
    energies = []
    for _ in range(1500):
        arm.step(np.zeros(3), FREE)
        energies.append(energy_j(arm.angles, arm.rates))
    assert energies[-1] < energies[0]
    assert max(energies) <= energies[0] * (1 + 1e-3)


def test_a_hand_trembles_as_far_as_it_is_told_to_and_its_rate_is_that_of_its_place() -> None:
    step_s, tremor_m = 1e-4, 0.15e-3
    targets, rates = np.zeros((2, 20_000, 3))
    for k in range(20_000):
        hand = np.zeros(simulated_arm.HAND_SIZE)
        simulated_arm.tremble(hand, tremor_m, step_s * k)
        targets[k] = hand[simulated_arm.HAND_TARGET : simulated_arm.HAND_TARGET + 3]
        rates[k] = hand[simulated_arm.HAND_RATE : simulated_arm.HAND_RATE + 3]
    np.testing.assert_allclose(np.abs(targets).max(axis=0), tremor_m, rtol=0.02)
    slopes = (targets[2:] - targets[:-2]) / (2.0 * step_s)
    np.testing.assert_allclose(rates[1:-1], slopes, atol=1e-5 * np.abs(slopes).max() + 1e-6)
    spectrum = np.abs(np.fft.rfft(targets[:, 0]))
    assert 8.0 <= np.fft.rfftfreq(20_000, step_s)[spectrum.argmax()] <= 12.0
