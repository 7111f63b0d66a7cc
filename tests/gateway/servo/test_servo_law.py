from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tests.gateway.kicks import ENDLESS_N
from trocar.protocol.bodies import LocalModel
from trocar.protocol.bodies.haptics import MODEL_COLUMNS, MODEL_CONTACT, MODEL_K
from trocar.services.gateway.instruments.servo import ServoLimits
from trocar.services.gateway.servo import servo_arrays, servo_law
from trocar.services.gateway.simulated.premium_model import COUNT_M
from trocar.services.mechanics.arrays import FloatArray

DT_S = 1e-3
TTL_S = 0.02
RATE_N_S = 200.0
STEP_N = RATE_N_S * DT_S


class Law:
    """The kernels with one arm's limits and memory."""

    def __init__(
        self,
        force_n: float = 3.0,
        rate_n_s: float = RATE_N_S,
        count_m: float = COUNT_M,
        friction_n: float = ENDLESS_N,
    ) -> None:
        self.limits = ServoLimits(force_n, 1.0, rate_n_s, 0.3, 1.2, count_m, friction_n).pack()
        self.model = np.zeros(MODEL_COLUMNS)
        self.now = np.zeros(servo_arrays.NOW_SIZE)
        self.now[servo_arrays.NOW_DT] = DT_S
        self.now[servo_arrays.NOW_TTL] = TTL_S
        self.now[servo_arrays.NOW_GAIN] = self.now[servo_arrays.NOW_GRASP_GAIN] = 1.0
        self.memory = np.zeros(servo_arrays.MEMORY_SIZE)
        self.motion = np.zeros(6)
        self.handle = np.zeros(2)

    def load(self, **fields: object) -> None:
        self.model[:] = LocalModel(**fields).row()  # type: ignore[arg-type]

    def force(self, age_s: float = 1e-3) -> FloatArray:
        self.now[servo_arrays.NOW_AGE] = age_s
        servo_law.servo_force(self.model, self.motion, self.limits, self.now, self.memory)
        return self.memory[:3].copy()

    def torque(self, age_s: float = 1e-3) -> float:
        self.now[servo_arrays.NOW_AGE] = age_s
        servo_law.servo_torque(self.model, self.handle, self.limits, self.now, self.memory)
        return float(self.memory[servo_arrays.MEMORY_TORQUE])

    def settle(self) -> FloatArray:
        for _ in range(50):
            force = self.force()
        return force


def _norm(force: FloatArray) -> float:
    return float(np.linalg.norm(force))


def test_force_is_the_linear_model_at_the_current_pose() -> None:
    law = Law()
    rng = np.random.default_rng(1)
    f0, x0, v0, x, v = (0.1 * rng.standard_normal(3) for _ in range(5))
    K, B = rng.standard_normal((3, 3)), rng.standard_normal((3, 3))
    law.load(
        force_n=tuple(f0), stiffness_n_m=tuple(K.ravel()), damping_n_s_m=tuple(B.ravel()),
        reference_position_m=tuple(x0), reference_velocity_m_s=tuple(v0),
    )  # fmt: skip
    law.motion[:3], law.motion[3:] = x, v
    np.testing.assert_allclose(law.settle(), f0 - K @ (x - x0) - B @ (v - v0), rtol=1e-12)


def test_a_model_is_used_as_it_is_up_to_5_ms_and_then_loses_its_spring_before_its_damping() -> None:
    shares = [
        (servo_law.elastic_share(a, TTL_S), servo_law.damping_share(a, TTL_S)) for a in (0.005, 0.01, 0.015, 0.02)
    ]
    np.testing.assert_allclose(shares, [(1.0, 1.0), (0.5, 1.0), (0.0, 1.0), (0.0, 0.0)], atol=1e-12)


def test_a_short_life_is_held_for_a_quarter_only() -> None:
    assert servo_law.elastic_share(0.002, 0.008) == 1.0
    assert servo_law.elastic_share(0.0021, 0.008) < 1.0


def test_what_is_left_of_an_old_model_only_brakes() -> None:
    law = Law()
    law.load(damping_n_s_m=(2.0, 0, 0, 0, 2.0, 0, 0, 0, 2.0), reference_velocity_m_s=(0.5, 0.0, 0.0))
    law.motion[3] = 0.1
    assert law.force(0.001)[0] > 0.0, "fresh, it drags the hand along with its reference"
    for _ in range(20):
        force = law.force(0.016)
    assert force[0] < 0.0, "old, it brakes"


@pytest.mark.parametrize("ttl_s", [0.02, 0.01, 0.1])
def test_a_dead_stream_is_zero_at_its_ttl_without_a_step(ttl_s: float) -> None:
    law = Law()
    law.now[servo_arrays.NOW_TTL] = ttl_s
    law.load(force_n=(3.0, 4.0, 0.0), in_contact=True)
    last = law.settle()
    assert _norm(last) == pytest.approx(min(3.0, RATE_N_S * (ttl_s - DT_S)))
    for k in range(1, round(ttl_s / DT_S) + 1):
        force = law.force(k * DT_S)
        assert _norm(force - last) <= STEP_N * (1 + 1e-12)
        last = force
    assert _norm(last) == pytest.approx(0.0, abs=1e-12)


N = 40
any_number = st.floats(-1e6, 1e6) | st.floats(allow_nan=True, allow_infinity=True)


@settings(max_examples=100)
@given(
    forces=arrays(float, (N, 3), elements=any_number),
    stiffnesses=arrays(float, N, elements=st.just(0.0) | any_number),
    motions=arrays(float, (N, 6), elements=st.floats(-1.0, 1.0)),
    reach=st.sampled_from([0.0, 1e-6, 1e-3, 10.0]),
    ages_s=arrays(float, N, elements=st.floats(0.0, 0.03)),
    gains=arrays(float, N, elements=st.floats(0.0, 1.0)),
)
def test_no_sequence_of_models_steps_above_the_rate_limit_or_beyond_what_can_be_taken_back(
    forces: FloatArray,
    stiffnesses: FloatArray,
    motions: FloatArray,
    reach: float,
    ages_s: FloatArray,
    gains: FloatArray,
) -> None:
    """Whatever the models say, numbers that are none among it, and wherever the hand is.

    A hand that goes far is owed energy, and then feels little: most of what there is to bound is felt near its place.
    """
    law = Law()
    last = np.zeros(3)
    for force_n, k, motion, age_s, gain in zip(forces, stiffnesses, motions, ages_s, gains, strict=True):
        law.load(force_n=tuple(force_n), stiffness_n_m=(k, 0, 0, 0, k, 0, 0, 0, k), in_contact=True)
        law.motion[:] = reach * motion
        law.now[servo_arrays.NOW_GAIN] = gain
        force = law.force(age_s)
        assert np.isfinite(force).all()
        along = min(1.0, max(0.0, float(force @ last) / max(float(last @ last), 1e-30)))
        assert _norm(force - along * last) <= STEP_N * (1 + 1e-9), "it may fall along itself, as the spring does"
        allowed = min(3.0, RATE_N_S * max(0.0, TTL_S - age_s))
        assert _norm(force) <= max(allowed, _norm(last) - STEP_N) * (1 + 1e-9) + 1e-12
        last = force


def test_a_late_tick_does_not_earn_a_larger_step() -> None:
    law = Law()
    law.load(force_n=(3.0, 0.0, 0.0), in_contact=True)
    law.now[servo_arrays.NOW_DT] = 1.0
    assert _norm(law.force()) == pytest.approx(RATE_N_S * servo_law.MAX_STEP_S)


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), 1e308])
def test_a_force_that_is_not_finite_is_zero_and_counted(bad: float) -> None:
    law = Law()
    law.load(force_n=(1.0, 0.0, 0.0), in_contact=True)
    law.settle()
    law.load(force_n=(bad, bad, bad), stiffness_n_m=(bad,) * 9, in_contact=True)
    law.motion[:3] = 10.0
    for _ in range(6):
        force = law.force()
    np.testing.assert_array_equal(force, 0.0)
    assert law.memory[servo_arrays.MEMORY_REFUSED] == 6


def test_a_torque_that_is_not_finite_is_zero_and_counted() -> None:
    law = Law()
    law.load(grasp_torque_nm=float("nan"))
    assert law.torque() == 0.0
    assert law.memory[servo_arrays.MEMORY_REFUSED] == 1


def test_grasp_torque_follows_its_model_within_rate_and_limit_and_fades() -> None:
    law = Law()
    law.load(grasp_torque_nm=0.1, grasp_stiffness_nm_rad=0.2, reference_angle_rad=0.5, grasp_damping_nm_s_rad=0.01)
    law.handle[:] = 0.6, 1.0
    torques = [law.torque() for _ in range(30)]
    assert torques[-1] == pytest.approx(0.1 - 0.2 * 0.1 - 0.01)
    law.load(grasp_torque_nm=9.0)
    torques += [law.torque() for _ in range(30)]
    assert torques[-1] == pytest.approx(0.3)
    torques += [law.torque(k * DT_S) for k in range(1, 21)]
    assert torques[-1] == pytest.approx(0.0, abs=1e-12)
    assert np.abs(np.diff(torques)).max() <= 0.3 * RATE_N_S / 3.0 * DT_S * (1 + 1e-9)


def test_a_hot_motor_is_held_to_its_continuous_force_until_it_is_cool() -> None:
    law = Law()
    law.load(force_n=(2.5, 0.0, 0.0), in_contact=True)
    forces = []
    for temperature in (0.69, 0.71, 0.6, 0.51, 0.49):
        law.now[servo_arrays.NOW_TEMPERATURE] = temperature
        forces.append(_norm(law.settle()))
    assert forces == pytest.approx([2.5, 1.0, 1.0, 1.0, 2.5])


class Wall:
    """A virtual wall at x = 0 and a hand's mass pushed into it: energy that comes out of the wall, largest so far."""

    MASS_KG, FRICTION_N_S_M, PUSH_N, COUNT_M = 0.075, 0.02, 0.5, 25e-6

    def __init__(self, stiffness_n_m: float, law: Law) -> None:
        self.stiffness = stiffness_n_m
        self.law = law
        law.now[servo_arrays.NOW_TTL] = 0.1
        self.x, self.v = 0.002, -0.03
        self.measured, self.filtered = 0.0, 0.0

    def run(self, seconds: float) -> float:
        out, largest = 0.0, 0.0
        for _ in range(round(seconds / DT_S)):
            force, before = self.servo(), self.x
            for _ in range(10):
                a = (force - self.FRICTION_N_S_M * self.v - self.PUSH_N) / self.MASS_KG
                self.v += 0.1 * DT_S * a
                self.x += 0.1 * DT_S * self.v
            out += force * (self.x - before)
            largest = max(largest, out)
        return largest

    def servo(self) -> float:
        measured = np.floor(self.x / self.COUNT_M) * self.COUNT_M
        self.filtered += 0.4 * ((measured - self.measured) / DT_S - self.filtered)
        self.measured = measured
        self.law.motion[0], self.law.motion[3] = measured, self.filtered
        inside = self.x < 0.0
        self.law.model[MODEL_CONTACT] = float(inside)
        self.law.model[MODEL_K] = self.stiffness if inside else 0.0
        return float(self.law.force()[0])


@pytest.mark.parametrize(("stiffness_n_m", "rate_n_s"), [(500.0, 200.0), (1000.0, 200.0), (3000.0, 1e4)])
def test_a_wall_stiffer_than_the_sampled_limit_gives_no_energy_bounded_and_much_if_not(
    stiffness_n_m: float, rate_n_s: float
) -> None:
    # Colgate and Schenkel: b > K T / 2 = 0.25 to 1.5 N s/m for these walls; the hand has 0.02.
    bounded = Wall(stiffness_n_m, Law(8.0, rate_n_s, friction_n=0.0)).run(3.0)
    without = Wall(stiffness_n_m, Law(8.0, rate_n_s)).run(3.0)
    one_count = 8.0 * Wall.COUNT_M
    assert bounded < 2 * one_count
    assert without > 50 * one_count


def test_a_free_hand_is_not_braked() -> None:
    law = Law()
    law.motion[3] = 0.2
    np.testing.assert_array_equal(law.settle(), 0.0)


def test_a_hand_that_presses_feels_the_wall_and_no_damping_beside_it() -> None:
    law = Law()
    law.load(stiffness_n_m=(200.0, 0, 0, 0, 200.0, 0, 0, 0, 200.0), in_contact=True)
    speed = 0.05
    law.motion[3] = -speed
    for k in range(1, 100):
        law.motion[0] = -speed * k * DT_S
        force = law.force()
        assert force[0] == pytest.approx(-200.0 * law.motion[0])
    assert law.memory[servo_arrays.MEMORY_ENERGY] == pytest.approx(0.5 * 200.0 * law.motion[0] ** 2, rel=0.05)


def test_a_force_falls_as_fast_as_the_spring_that_is_let_go_and_no_faster() -> None:
    """4 mm deep in 500 N/m, left at 0.7 m/s: 0.35 N a tick, where the rate limit is 0.2."""
    law, k = Law(), 500.0
    law.load(stiffness_n_m=(k, 0, 0, 0, k, 0, 0, 0, k), in_contact=True)
    for step in range(1, 201):
        law.motion[0] = -4e-3 * step / 200
        law.force()
    falls = [law.force()[0]]
    for step in range(1, 5):
        law.motion[0] = -4e-3 + 0.7e-3 * step
        falls.append(law.force()[0])
        assert falls[-1] == pytest.approx(-k * law.motion[0], rel=0.25)
        assert falls[-2] - falls[-1] <= 2.0 * k * 0.7e-3


def test_a_force_that_is_gone_upstream_fades_from_a_hand_that_rests() -> None:
    law = Law()
    law.load(stiffness_n_m=(500.0, 0, 0, 0, 500.0, 0, 0, 0, 500.0), in_contact=True)
    for step in range(1, 201):
        law.motion[0] = -4e-3 * step / 200
        last = law.force()[0]
    law.load()
    for _ in range(10):
        force = law.force()[0]
        assert last - force == pytest.approx(STEP_N)
        last = force


def test_a_hand_that_was_let_go_in_a_contact_has_no_savings_when_its_force_comes_back() -> None:
    law = Law()
    law.load(stiffness_n_m=(500.0, 0, 0, 0, 500.0, 0, 0, 0, 500.0), in_contact=True)
    for step in range(1, 201):
        law.motion[0] = -4e-3 * step / 200
        law.force()
    assert law.memory[servo_arrays.MEMORY_ENERGY] > 1e-3
    law.now[servo_arrays.NOW_GAIN] = 0.0
    np.testing.assert_array_equal(law.settle(), 0.0)
    assert law.memory[servo_arrays.MEMORY_ENERGY] <= 0.0


def test_what_jaws_hold_when_their_torque_begins_counts_up_to_the_largest_torque() -> None:
    """They may give back what the torque can have put into them: 0.3 N m, however far the model is from the handle."""
    law = Law()
    law.load(grasp_torque_nm=5.0, grasp_stiffness_nm_rad=2.0)
    law.now[servo_arrays.NOW_GRASP_GAIN] = 0.5
    law.torque()
    assert law.memory[servo_arrays.MEMORY_TORQUE + servo_arrays.MEMORY_ENERGY] == pytest.approx(0.5 * 0.3**2 / 2.0)
