"""The simulated arm as a real one: forces that act late, each at another time, and less friction than is told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.gateway.hdapi.hdapi_bench import two_arms
from tests.gateway.instruments.test_instrument import FakeArm
from trocar.protocol.bodies import LocalModel
from trocar.services.gateway import drivers
from trocar.services.gateway.devices.driver import Place
from trocar.services.gateway.drivers.phantom_simulated import Driver
from trocar.services.gateway.hdapi import cells
from trocar.services.gateway.instruments import instrument
from trocar.services.gateway.instruments.instrument import WRITE_SPAN, Instrument
from trocar.services.gateway.instruments.servo import Servo, ServoLimits
from trocar.services.gateway.servo import servo_arrays
from trocar.services.gateway.servo.energy_bound import ADVANCE_J
from trocar.services.gateway.simulated import premium_model
from trocar.services.runtime.config.rig import DriverSettings, InstrumentSettings, Mount

TICK_NS = 1_000_000


def simulated(**settings: float) -> Driver:
    row = DriverSettings(driver="phantom_simulated", device="phantom_premium_1_5", settings=settings)
    arm = drivers.load_arm(row, Place("left", Mount()))
    assert isinstance(arm, Driver)
    arm.open()
    arm.enable()
    return arm


def given_in_a_tick_j(arm: Driver, force_n: float, tick: int) -> float:
    arm.write(np.array([0.0, 0.0, force_n]))
    before_j = float(arm.arm.given[0])
    arm.read((tick + 1) * TICK_NS, np.zeros(servo_arrays.READ_SIZE))
    return float(arm.arm.given[0]) - before_j


def test_a_force_acts_after_the_delay_that_is_set_and_that_is_told() -> None:
    late = simulated(write_delay_s=1.5e-3)
    late.read(TICK_NS, np.zeros(servo_arrays.READ_SIZE))
    gave = [given_in_a_tick_j(late, 2.0, tick) for tick in range(1, 4)]
    assert gave[0] == 0.0
    assert 0.0 < gave[1] < gave[2]
    assert late.write_span_ns(0, 10) == 1_500_000, "whatever this host takes"
    assert simulated().write_span_ns(0, 10) == 0


def test_a_delay_that_jitters_is_never_longer_than_the_one_that_is_set() -> None:
    arm, spans = simulated(write_delay_s=1e-3, write_jitter=0.5), []
    for _ in range(200):
        arm.write(np.zeros(3))
        spans.append(arm.write_span_ns(0, 0))
    assert 0.5e6 <= min(spans) < 0.55e6
    assert 0.95e6 < max(spans) <= 1e6


def test_an_arm_of_less_friction_is_moved_by_less() -> None:
    """At the tip, 264 mm away, 0.01 N m are 38 mN; half of them hold against 15 mN and not against 30 mN."""
    moved = []
    for friction, force_n in ((1.0, 0.03), (0.5, 0.03), (0.5, 0.015)):
        arm = simulated(true_friction=friction, hand_stiffness_n_m=0.0, hand_damping_n_s_m=0.0)
        start = arm.arm.angles.copy()
        arm.read(TICK_NS, np.zeros(servo_arrays.READ_SIZE))
        for tick in range(1, 200):
            arm.write(np.array([0.0, force_n, 0.0]))
            arm.read((tick + 1) * TICK_NS, np.zeros(servo_arrays.READ_SIZE))
        moved.append(abs(arm.arm.angles[0] - start[0]) > 1e-6)
    assert moved == [False, True, False]


@pytest.mark.parametrize("late_s", [0.3e-3, 1.2e-3])
def test_a_hand_that_shakes_an_arm_whose_forces_are_late_gets_nothing(late_s: float) -> None:
    """Through driver, instrument and servo, which measures the delay; and if it did not, the hand would gain."""
    assert shaken_j(late_s, measures=True) <= ADVANCE_J
    assert shaken_j(late_s, measures=False) > 100.0 * ADVANCE_J


def shaken_j(late_s: float, *, measures: bool) -> float:
    """Return the work of the motors past the friction that is sure, J, on an arm that is led to and fro in a wall."""
    arm = simulated(write_delay_s=late_s, hand_stiffness_n_m=2000.0, hand_damping_n_s_m=5.0)
    if not measures:
        arm.write_span_ns = lambda read_ns, written_ns: 0  # type: ignore[method-assign]
    servo = Servo(ServoLimits(8.0, 8.0, 2000.0, 0.3, 10.0, premium_model.COUNT_M, 0.01), ramp_s=0.0)
    row = InstrumentSettings(name="left", port_m=(0.0, 0.0, 0.1), arm=DriverSettings(driver="fake"))
    tool = Instrument(row, arm, None, servo)
    tool.servo.engagement.open(calibrated=True)
    centre, most_j, rubbed_j = premium_model.centre(), 0.0, 0.0
    for tick in range(1, 2500):
        depth_m = 4e-3 * np.sin(2.0 * np.pi * 25.0 * 1e-3 * tick) if tick > 200 else -1e-3
        arm._hand[:3] = centre - (0.0, 0.0, depth_m)
        before = arm.arm.angles.copy()
        tool.read(tick * TICK_NS)
        rubbed_j += premium_model.COULOMB * float(np.abs(arm.arm.angles - before).sum())
        inside = bool(tool._motion[2] < 0.0)
        model = LocalModel(stiffness_n_m=(0.0,) * 8 + (1500.0 * inside,), in_contact=inside)
        servo.accept(np.array(model.row()), 0.02, tick * TICK_NS, 1)
        tool.answer_pose(tick * TICK_NS + 1)
        most_j = max(most_j, float(arm.arm.given[0]) - rubbed_j)
    return most_j


def test_an_instrument_measures_how_long_a_write_takes(monkeypatch: pytest.MonkeyPatch) -> None:
    times_ns = iter(range(0, 10**9, 70_000))
    monkeypatch.setattr(instrument.time, "monotonic_ns", lambda: next(times_ns))
    servo = Servo(ServoLimits(3.0, 1.0, 200.0, 0.3, 1.2, 30e-6, 0.01, 0.1e-3), ramp_s=0.0)
    row = InstrumentSettings(name="left", port_m=(0.0, 0.0, 0.1), arm=DriverSettings(driver="fake"))
    tool = Instrument(row, FakeArm(), None, servo)
    tool.read(0)
    tool.answer_pose(1)
    assert servo.arm_span.newest_s == pytest.approx(70e-6)
    assert tool.links()[f"{WRITE_SPAN}.left.arm"] == servo.arm_span.longest_s
    for calibrated, fault in ((False, ""), (True, ""), (True, "it is unplugged")):
        tool.arm.calibrated, tool.arm.fault = calibrated, fault
        assert tool.links()["arm_calibrated.left"] == float(calibrated and not fault), "of this arm, not of the rig"
    tool.read(0)
    tool.answer_pose(2)
    now = servo._now
    assert now[servo_arrays.NOW_LATE_S] == pytest.approx(0.1e-3 + 70e-6), "the interface's, and what was measured"


def test_the_librarys_thread_measures_until_its_frame_has_ended(tmp_path: Path) -> None:
    with two_arms(tmp_path) as bench:
        bench.open()
        bench.run(20, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        arm = bench.left.arm
        assert arm is not None
        assert arm.cell.delay_s == bench.left.limits.delay_s == 1e-3
        assert arm.port.newest[cells.SEEN_SPAN] == arm.cell.longest_s >= arm.cell.wrote_s >= 0.0
        assert bench.left.gauges()[WRITE_SPAN] == arm.cell.longest_s
