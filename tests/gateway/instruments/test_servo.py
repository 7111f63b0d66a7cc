from __future__ import annotations

import numpy as np
import pytest

from tests.gateway.kicks import ENDLESS_N, kicks_n
from trocar.protocol.bodies import LocalModel
from trocar.services.gateway.instruments.servo import OVERRUNS, Servo, ServoLimits
from trocar.services.gateway.servo.engagement import State

TTL_S = 0.02
LIMITS = ServoLimits(3.0, 1.0, 200.0, 0.3, 1.2, 30e-6, ENDLESS_N)
TICK_NS = 1_000_000


class Bench:
    """A servo, its clock, and a haptics process that answers every tick in time unless told otherwise."""

    def __init__(self) -> None:
        self.servo = Servo(LIMITS, ramp_s=0.1)
        self.servo.engagement.open(calibrated=True)
        self.servo.grasp_on = True
        self.now_ns = 1_000_000_000
        self.motion = np.zeros(6)
        self.model: LocalModel | None = LocalModel()
        self.incarnation = 1
        self.forces: list[np.ndarray] = []

    def run(self, ticks: int, tick_ns: int = TICK_NS) -> np.ndarray:
        for _ in range(ticks):
            sampled_ns, self.now_ns = self.now_ns, self.now_ns + tick_ns
            if self.model is not None:
                self.servo.accept(np.array(self.model.row()), TTL_S, sampled_ns, self.incarnation)
            self.servo.step(self.now_ns, self.motion, 0.0, calibrated=True)
            self.forces.append(self.servo.force_n.copy())
        return self.forces[-1]

    def engage(self) -> None:
        self.run(300)
        assert self.servo.engagement.state is State.ACTIVE
        self.model = LocalModel(force_n=(0.0, 0.0, 2.0), in_contact=True)
        assert self.run(50)[2] == pytest.approx(2.0)

    def largest_step(self) -> float:
        return float(kicks_n(np.array(self.forces)).max())


def test_a_silent_haptics_is_limp_within_the_time_to_live_and_never_steps() -> None:
    bench = Bench()
    bench.engage()
    bench.model = None
    assert bench.run(2)[2] == pytest.approx(2.0), "two lost answers are not felt"
    assert np.linalg.norm(bench.run(16)) <= 0.2
    assert bench.servo.engagement.state is State.ACTIVE
    assert np.linalg.norm(bench.run(1)) == 0.0, "20 ms after the sample that was answered last"
    assert bench.servo.engagement.state is State.STALE
    assert bench.largest_step() <= 0.2 + 1e-9


def test_a_haptics_that_keeps_answering_the_same_sample_is_as_good_as_silent() -> None:
    bench = Bench()
    bench.engage()
    frozen_ns, model = bench.now_ns, bench.model
    assert model is not None
    bench.model = None
    for _ in range(20):
        bench.servo.accept(np.array(model.row()), TTL_S, frozen_ns, 1)
        force = bench.run(1)
    assert np.linalg.norm(force) == 0.0


def test_force_comes_back_only_when_little_is_asked_for_and_by_a_ramp() -> None:
    bench = Bench()
    bench.engage()
    model, bench.model = bench.model, None
    bench.run(50)
    bench.model = model
    assert np.linalg.norm(bench.run(500)) == 0.0, "2 N at once is no way to come back"
    bench.model = LocalModel()
    bench.run(150)
    bench.model = LocalModel(force_n=(0.0, 0.0, 0.2), in_contact=True)
    bench.run(30)
    assert bench.servo.engagement.engaged


def test_a_new_haptics_process_must_engage_anew() -> None:
    bench = Bench()
    bench.engage()
    bench.incarnation = 2
    assert np.linalg.norm(bench.run(15)) == 0.0
    assert bench.servo.engagement.state is State.STALE
    assert bench.largest_step() <= 0.2 + 1e-9


def test_three_late_ticks_let_go() -> None:
    bench = Bench()
    bench.engage()
    bench.run(OVERRUNS - 1, tick_ns=2_500_000)
    assert bench.servo.engagement.state is State.ACTIVE
    bench.run(1)
    bench.run(OVERRUNS, tick_ns=2_500_000)
    assert bench.servo.engagement.state is State.STALE


def test_a_hand_faster_than_the_device_allows_is_a_fault() -> None:
    bench = Bench()
    bench.engage()
    bench.motion[3] = 1.3
    bench.run(1)
    assert bench.servo.engagement.state is State.FAULT
    assert "1.30 m/s" in bench.servo.engagement.fault
    bench.motion[3] = 0.0
    assert np.linalg.norm(bench.run(20)) == 0.0


def test_a_pose_that_is_no_number_is_a_fault_and_never_a_force() -> None:
    bench = Bench()
    bench.engage()
    bench.motion[1] = np.nan
    bench.run(1)
    assert bench.servo.engagement.state is State.FAULT
    assert np.isfinite(bench.forces).all()
    assert np.linalg.norm(bench.run(20)) == 0.0


def test_grasp_torque_goes_to_zero_when_its_drive_is_off() -> None:
    bench = Bench()
    bench.engage()
    bench.model = LocalModel(grasp_torque_nm=0.1, in_contact=True)
    handle = np.zeros(2)
    torques = []
    for k in range(170):  # the ramp takes 100 ms
        bench.servo.grasp_on = k < 150
        bench.run(1)
        bench.servo.step_grasp(bench.now_ns, handle)
        torques.append(bench.servo.torque_nm)
    assert torques[149] == pytest.approx(0.1)
    assert torques[-1] == 0.0
    assert np.abs(np.diff(torques)).max() <= 0.02 + 1e-9


@pytest.mark.parametrize("back_ms", [50, 1000])
def test_a_clock_that_goes_back_moves_neither_force_nor_torque(back_ms: int) -> None:
    bench = Bench()
    bench.engage()
    bench.model = LocalModel(grasp_torque_nm=0.1, in_contact=True)
    for _ in range(150):
        bench.run(1)
        bench.servo.step_grasp(bench.now_ns, np.zeros(2))
    bench.model = None
    bench.now_ns -= back_ms * TICK_NS
    for _ in range(3):
        bench.servo.step_grasp(bench.now_ns, np.zeros(2))
        assert 0.0 <= bench.servo.torque_nm <= 0.1
        bench.run(1)
    bench.servo.engagement.let_go()
    assert 0.0 <= bench.servo.engagement.gain <= 1.0
    assert bench.largest_step() <= 0.2 + 1e-9


STEP_NM = LIMITS.torque_nm * LIMITS.force_rate_n_s / LIMITS.force_n * 1e-3


@pytest.mark.parametrize("late_ticks", [2, 3, 4, 12, 16, 30])
def test_a_handle_that_is_served_late_is_not_let_go_at_once(late_ticks: int) -> None:
    """Shut jaws, two handles in turn, and a gateway that is held up: models are old when it looks again."""
    bench = Bench()
    bench.engage()
    bench.model = LocalModel(grasp_torque_nm=0.048, in_contact=True)
    handle, torques = np.zeros(2), []
    for k in range(200):
        bench.run(1)
        bench.run(1, late_ticks * TICK_NS if k == 150 else TICK_NS)
        bench.servo.step_grasp(bench.now_ns, handle)
        torques.append(bench.servo.torque_nm)
    assert torques[149] == pytest.approx(0.048)
    assert min(torques[150:]) < 0.048 or late_ticks < 6
    assert np.abs(np.diff(torques)).max() <= STEP_NM * (1 + 1e-9)
