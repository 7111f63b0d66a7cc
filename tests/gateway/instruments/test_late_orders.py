"""How fast force falls when the order that it follows is late, measured tick by tick against what the docs say.

docs/explanation/gateway.md: unchanged up to an age of 5 ms, its spring gone at 15 ms, nothing left at 20 ms; and never
more than what the rate limit of 200 N/s can still take back by then. The numbers stand here again: the code's own would
move with it.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.gateway.kicks import ENDLESS_N
from trocar.protocol.bodies import LocalModel
from trocar.services.gateway.instruments.servo import Servo, ServoLimits
from trocar.services.gateway.servo.engagement import State

TTL_S, HELD_S, SPRING_GONE_S, RATE_N_S = 0.020, 0.005, 0.015, 200.0
LIMITS = ServoLimits(3.0, 1.0, RATE_N_S, 0.3, 1.2, 30e-6, ENDLESS_N)
TICK_NS = 1_000_000
TICK_S = 1e-9 * TICK_NS
LITTLE = 1e-9


class Late:
    """A servo in contact whose answers are each of one age; the hand stands still."""

    def __init__(self, force_n: float, stiffness: float = 0.0) -> None:
        self.servo = Servo(LIMITS, ramp_s=0.05)
        self.servo.engagement.open(calibrated=True)
        self.now_ns = 1_000_000_000
        self.motion = np.zeros(6)
        self._answer(300, LocalModel(), 0)
        assert self.servo.engagement.state is State.ACTIVE
        matrix = (stiffness, 0.0, 0.0, 0.0, stiffness, 0.0, 0.0, 0.0, stiffness)
        self.model = LocalModel(force_n=(0.0, 0.0, force_n), stiffness_n_m=matrix, in_contact=True)
        assert self._answer(60, self.model, 0)[-1] == pytest.approx(force_n)

    def _answer(self, ticks: int, model: LocalModel, age_ns: int) -> np.ndarray:
        forces = []
        for _ in range(ticks):
            self.now_ns += TICK_NS
            self.servo.accept(np.array(model.row()), TTL_S, self.now_ns - age_ns, 1)
            forces.append(self._step())
        return np.array(forces)

    def _step(self) -> float:
        self.servo.step(self.now_ns, self.motion, 0.0, calibrated=True)
        return float(self.servo.force_n[2])

    def late(self, ticks: int, age_s: float) -> np.ndarray:
        """Return the force of each tick whose answer is to a sample of this age, (ticks,)."""
        return self._answer(ticks, self.model, round(1e9 * age_s))

    def silent(self, ticks: int) -> np.ndarray:
        """Return the force of each tick since the last answer, (ticks,)."""
        forces = []
        for _ in range(ticks):
            self.now_ns += TICK_NS
            forces.append(self._step())
        return np.array(forces)


def documented(force_n: float, age_s: np.ndarray) -> np.ndarray:
    """Return what is left of a spring's force by the docs, N."""
    share = np.clip((SPRING_GONE_S - age_s) / (SPRING_GONE_S - HELD_S), 0.0, 1.0)
    return np.minimum(force_n * share, np.maximum(0.0, RATE_N_S * (TTL_S - age_s)))


@given(st.floats(0.05, 2.9))
@settings(max_examples=25, deadline=None)
def test_after_the_last_order_force_falls_to_zero_at_the_documented_rate(force_n: float) -> None:
    bench = Late(force_n)
    ages = TICK_S * np.arange(1, 31)
    forces = bench.silent(30)
    left = force_n
    for force, may in zip(forces, documented(force_n, ages), strict=True):
        left = max(float(may), left - RATE_N_S * TICK_S)  # above 2 N the spring fades faster than force may fall
        assert force == pytest.approx(left, abs=1e-9)
    assert np.all(forces <= RATE_N_S * np.maximum(0.0, TTL_S - ages) + LITTLE), "what can still be taken back"
    assert np.all(forces[19:] == 0.0)
    assert bench.servo.engagement.state is State.STALE


def test_a_force_is_whole_for_5_ms_half_at_10_and_gone_at_15() -> None:
    forces = Late(1.0).silent(20)
    assert forces[:5] == pytest.approx(np.ones(5))
    assert forces[9] == pytest.approx(0.5)
    assert forces[6:14] == pytest.approx(0.1 * np.arange(8, 0, -1))
    assert forces[14:] == pytest.approx(np.zeros(6))


@given(st.floats(0.05, 2.9), st.floats(0.0, 0.03))
@settings(max_examples=40, deadline=None)
def test_orders_that_are_all_late_have_the_force_that_their_age_leaves(force_n: float, age_s: float) -> None:
    """However steady a stream is: what answers an old sample has the force of an old answer."""
    bench = Late(force_n)
    forces = bench.late(40, age_s)
    assert np.abs(np.diff(forces, prepend=force_n)).max() <= RATE_N_S * TICK_S + LITTLE
    assert forces[-1] == pytest.approx(float(documented(force_n, np.array([age_s]))[0]), abs=1e-6)
    if age_s >= TTL_S:
        assert bench.servo.engagement.state is State.STALE


@given(st.floats(0.5, 2.9), st.integers(1, 14), st.floats(0.0, 0.018))
@settings(max_examples=40, deadline=None)
def test_a_late_order_after_a_gap_brings_back_no_more_than_its_age_allows(
    force_n: float, gap: int, age_s: float
) -> None:
    bench = Late(force_n)
    before = bench.silent(gap)[-1]
    after = bench.late(1, age_s)[-1]
    assert after <= before + RATE_N_S * TICK_S + LITTLE
    allowed = float(documented(force_n, np.array([age_s]))[0])
    assert after <= max(allowed, before - RATE_N_S * TICK_S) + 1e-6


@pytest.mark.parametrize("stiffness", [100.0, 1000.0])
def test_a_hand_that_goes_deeper_into_a_late_spring_does_not_keep_its_force_up(stiffness: float) -> None:
    bench = Late(0.5, stiffness)
    forces = []
    for tick in range(1, 26):
        bench.motion[2] -= 2e-5  # 20 mm/s
        forces.append(bench.silent(1)[0])
        spring_n = 0.5 + stiffness * 2e-5 * tick
        assert forces[-1] <= documented(spring_n, np.array([tick * TICK_S]))[0] + RATE_N_S * TICK_S + LITTLE
    assert forces[14:] == pytest.approx(np.zeros(11), abs=RATE_N_S * TICK_S)
    assert forces[19:] == pytest.approx(np.zeros(6))


def test_damping_outlives_the_spring_but_never_what_can_be_taken_back() -> None:
    """2 N of damping against a steady hand: whole up to 10 ms, where the rate limit begins to count, and gone at 20."""
    bench = Late(0.1)
    damping = (4.0, 0.0, 0.0, 0.0, 4.0, 0.0, 0.0, 0.0, 4.0)
    bench.model = LocalModel(damping_n_s_m=damping, in_contact=True)
    bench.motion[5] = -0.5
    forces = []
    for tick in range(1, 61):
        bench.motion[2] -= 0.5 * TICK_S
        forces.append((bench.late(1, 0.0) if tick <= 30 else bench.silent(1))[0])
    assert forces[29] == pytest.approx(2.0)
    ages = TICK_S * np.arange(1, 31)
    assert forces[30:] == pytest.approx(np.minimum(2.0, RATE_N_S * np.maximum(0.0, TTL_S - ages)))
