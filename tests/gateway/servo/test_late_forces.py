"""The books never say less than what a hand was really given, however late forces and torques come.

The judge knows when each force began to act, and adds up the work itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.gateway.servo.test_servo_law import DT_S, TTL_S
from trocar.protocol.bodies import LocalModel
from trocar.protocol.bodies.haptics import MODEL_COLUMNS
from trocar.services.gateway.devices.driver import HandleLimits
from trocar.services.gateway.instruments.servo import Servo, ServoLimits
from trocar.services.gateway.servo import servo_law
from trocar.services.gateway.servo.energy_bound import ADVANCE_J, FORGIVEN_W
from trocar.services.gateway.servo.engagement import State
from trocar.services.gateway.servo.servo_arrays import (
    FLIGHTS,
    MEMORY_ENERGY,
    MEMORY_FORCE,
    MEMORY_SIZE,
    MEMORY_TORQUE,
    MEMORY_UNKNOWN,
    NOW_AGE,
    NOW_DT,
    NOW_GAIN,
    NOW_GRASP_GAIN,
    NOW_LAST_LATE_S,
    NOW_LATE_S,
    NOW_SIZE,
    NOW_TTL,
)
from trocar.services.gateway.simulated.write_delay import WRITE_SIZE, WRITES, pass_time, write_late
from trocar.services.mechanics.arrays import FloatArray

TICKS = 60
FRICTION, FRICTION_NM = 0.02, 0.001


@dataclass(frozen=True)
class Course:
    """What happens in each of n ticks.

    Attributes:
        place: (n, 3). Where the hand is, m; between ticks it moves evenly. An angle is its first coordinate.
        force: (n, 3). What the model asks for there, N.
        stiffness: (n,). Of the model, N/m.
        late_s: (n,). How late the force of the tick acts.
    """

    place: FloatArray
    force: FloatArray
    stiffness: FloatArray
    late_s: FloatArray


def course(seed: int, speed_m_s: float, lazy: float, latest_s: float, jitter: float) -> Course:
    """Draw a hand: a walk whose steps resemble the ones before as much as it is `lazy`."""
    draw = np.random.default_rng(seed)
    step, place = np.zeros(3), np.zeros((TICKS, 3))
    for k in range(1, TICKS):
        step = lazy * step + (1.0 - lazy) * speed_m_s * DT_S * draw.standard_normal(3)
        place[k] = place[k - 1] + step
    stiffness = draw.choice([0.0, 100.0, 1000.0, 3000.0], TICKS)
    return Course(
        place=place,
        force=2.0 * draw.standard_normal((TICKS, 3)) * (draw.random((TICKS, 1)) < 0.9),
        stiffness=stiffness,
        late_s=latest_s * (1.0 - jitter * draw.random(TICKS)),
    )


class Bench:
    """A law that knows how late its forces may be, and the judge."""

    def __init__(self, late_s: float, friction: float, *, handle: bool) -> None:
        own = HandleLimits(1e-9, friction, 0.0, 0.0)
        limits = ServoLimits(3.0, 1.0, 200.0, 3.0, 1.2, 1e-9, friction, handle=own)
        self.limits, self.handle = limits.pack(), handle
        self.memory, self.now, self.model = np.zeros(MEMORY_SIZE), np.zeros(NOW_SIZE), np.zeros(MODEL_COLUMNS)
        self.now[[NOW_DT, NOW_TTL, NOW_AGE]] = DT_S, TTL_S, 1e-3
        self.now[[NOW_GAIN, NOW_GRASP_GAIN]] = 1.0
        self.now[[NOW_LAST_LATE_S, NOW_LATE_S]] = late_s
        self.books = self.memory[MEMORY_TORQUE:] if handle else self.memory
        self.friction, self.writes = friction, np.zeros((WRITES, WRITE_SIZE))
        self.given_j = self.rubbed_j = 0.0

    def run(self, course: Course, rubs: float = 1.0) -> list[float]:
        """Return after each tick by how much the books exceed what the hand has really put in, J.

        The true friction is ``rubs`` times as large as that which is told.
        """
        excess, mean, before = [], np.zeros(3), course.place[0]
        for k, place in enumerate(course.place):
            way = place - before
            if self.handle:
                way = way * (1.0, 0.0, 0.0)
            pass_time(self.writes, DT_S, mean)
            self.given_j += float(mean @ way)
            self.rubbed_j += rubs * self.friction * float(np.linalg.norm(way))
            before = place
            self._step(course, k)
            excess.append(float(self.books[MEMORY_ENERGY]) + self.given_j - self.rubbed_j)
            write_late(self.writes, *self._force(), float(course.late_s[k]))
        return excess

    def _step(self, course: Course, k: int) -> None:
        stiff, place, force = float(course.stiffness[k]), course.place[k], course.force[k]
        if self.handle:
            self.model[:] = LocalModel(
                grasp_torque_nm=float(force[0]), grasp_stiffness_nm_rad=stiff, reference_angle_rad=float(place[0])
            ).row()
            servo_law.servo_torque(self.model, np.array([place[0], 0.0]), self.limits, self.now, self.memory)
            return
        self.model[:] = LocalModel(
            force_n=tuple(force.tolist()),
            stiffness_n_m=(stiff, 0.0, 0.0, 0.0, stiff, 0.0, 0.0, 0.0, stiff),
            reference_position_m=tuple(place.tolist()),
            in_contact=bool(force.any()),
        ).row()
        motion = np.concatenate([place, np.zeros(3)])
        servo_law.servo_force(self.model, motion, self.limits, self.now, self.memory)

    def _force(self) -> list[float]:
        force: list[float] = self.books[MEMORY_FORCE : MEMORY_FORCE + 3].tolist()
        return force


ALLOWED_J = ADVANCE_J + TICKS * DT_S * FORGIVEN_W + 1e-12


@settings(max_examples=150, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    speed_m_s=st.sampled_from([0.01, 0.1, 1.0]),
    lazy=st.sampled_from([0.0, 0.8, 0.98]),
    told_ms=st.floats(0.0, FLIGHTS),
    late=st.floats(0.0, 1.0),
    jitter=st.floats(0.0, 1.0),
    rubs=st.floats(1.0, 4.0),
    friction=st.sampled_from([0.0, FRICTION]),
    handle=st.booleans(),
)
def test_a_hand_has_never_put_in_less_than_the_books_say(
    seed: int,
    speed_m_s: float,
    lazy: float,
    told_ms: float,
    late: float,
    jitter: float,
    rubs: float,
    friction: float,
    handle: bool,
) -> None:
    """The true delay is anywhere up to the longest that is known, anew in each tick."""
    latest_s = 1e-3 * told_ms
    bench = Bench(latest_s, friction, handle=handle)
    excess = bench.run(course(seed, speed_m_s, lazy, late * latest_s, jitter), rubs)
    assert bench.books[MEMORY_UNKNOWN] == 0.0
    assert max(excess) <= ALLOWED_J


@pytest.mark.parametrize("handle", [False, True])
def test_books_that_know_of_no_delay_say_less_than_a_hand_was_given(handle: bool) -> None:
    """As they did: K v^2 tau T in each tick, with one sign going in and coming out; so the judge can find it."""
    depth_m, stiffness_n_m = 2e-3 * np.sin(0.3 * np.arange(TICKS)), 1000.0
    place = np.stack([-depth_m, 0.0 * depth_m, 0.0 * depth_m], axis=1)
    shaken = Course(place, -stiffness_n_m * place, np.full(TICKS, stiffness_n_m), np.full(TICKS, 0.3e-3))
    told, untold = (Bench(each, 1e-4, handle=handle) for each in (0.3e-3, 0.0))
    assert max(told.run(shaken)) <= ALLOWED_J
    assert max(untold.run(shaken)) > 10.0 * ALLOWED_J


@pytest.mark.parametrize("handle", [False, True])
def test_a_force_that_comes_later_than_the_books_cover_fades(handle: bool) -> None:
    bench = Bench(0.0, 10.0, handle=handle)
    steady = Course(np.zeros((TICKS, 3)), np.full((TICKS, 3), 1.0), np.zeros(TICKS), np.zeros(TICKS))
    bench.run(steady)
    assert bench.books[MEMORY_FORCE] == pytest.approx(1.0)
    for measured_s, is_felt in ((FLIGHTS * DT_S, True), (FLIGHTS * DT_S + 1e-6, False)):
        bench.now[[NOW_LAST_LATE_S, NOW_LATE_S]] = measured_s
        before = bench.books[MEMORY_FORCE]
        for _ in range(TICKS):
            bench._step(steady, 0)
            assert abs(bench.books[MEMORY_FORCE] - before) <= 0.2 + 1e-12, "it never steps"
            before = bench.books[MEMORY_FORCE]
        assert (bench.books[MEMORY_FORCE] != 0.0) == is_felt


def test_an_arm_whose_forces_come_too_late_must_engage_anew() -> None:
    servo, now_ns = Servo(ServoLimits(3.0, 1.0, 200.0, 0.3, 1.2, 30e-6, 10.0), ramp_s=0.0), 1_000_000_000
    servo.engagement.open(calibrated=True)

    def run(ticks: int) -> None:
        nonlocal now_ns
        for _ in range(ticks):
            servo.accept(np.array(LocalModel().row()), TTL_S, now_ns, 1)
            now_ns += 1_000_000
            servo.step(now_ns, np.zeros(6), 0.0, calibrated=True)

    run(200)
    assert servo.engagement.state is State.ACTIVE
    servo.arm_span.note(2.9e-3, 1e-3)
    run(10)
    assert servo.engagement.state is State.ACTIVE
    servo.arm_span.note(3.1e-3, 1e-3)
    run(10)
    assert servo.engagement.state is State.STALE
    servo.arm_span.note(0.1e-3, 1e-3)
    run(200)
    assert servo.engagement.state is State.ACTIVE


def test_what_is_told_of_a_delay_adds_to_what_is_measured_and_the_longest_of_late_counts() -> None:
    servo = Servo(ServoLimits(3.0, 1.0, 200.0, 0.3, 1.2, 30e-6, 10.0, 0.5e-3), ramp_s=0.0)
    for span_s in (0.2e-3, 0.9e-3, 0.1e-3):
        servo.arm_span.note(span_s, 1e-3)
        assert servo.arm_span.longest_s >= servo.arm_span.newest_s == span_s
    assert servo.arm_span.longest_s == pytest.approx(0.9e-3, rel=1e-3)
    servo.arm_span.note(0.1e-3, 10.0)
    assert servo.arm_span.longest_s == pytest.approx(0.1e-3), "not for ever"


def test_forces_under_way_come_in_order_and_one_that_is_overtaken_never_acts() -> None:
    writes, mean = np.zeros((WRITES, WRITE_SIZE)), np.zeros(3)
    write_late(writes, 1.0, 0.0, 0.0, 0.25e-3)
    pass_time(writes, 1e-3, mean)
    assert mean[0] == pytest.approx(0.75)
    write_late(writes, 2.0, 0.0, 0.0, 2.5e-3)
    write_late(writes, 4.0, 0.0, 0.0, 0.5e-3)
    pass_time(writes, 1e-3, mean)
    assert mean[0] == pytest.approx(0.5 * 1.0 + 0.5 * 4.0)
    for _ in range(3):
        pass_time(writes, 1e-3, mean)
        assert mean[0] == 4.0
