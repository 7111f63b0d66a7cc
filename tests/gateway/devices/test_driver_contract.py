"""The contract that every driver file keeps. A new file is in it without a line here: it brings its own bench."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import astuple
from pathlib import Path

import numpy as np
import pytest

from tests.gateway.devices.bench import TICK_S, Bench, BenchUnavailable, SteppedClock, open_bench
from tests.patience import PATIENCE_S
from trocar.protocol.bodies.haptics import MODEL_COLUMNS, MODEL_F0
from trocar.services.gateway import drivers
from trocar.services.gateway.devices import driver
from trocar.services.gateway.devices.driver import Arm, GraspHandle, Place
from trocar.services.gateway.servo import servo_arrays
from trocar.services.runtime.config.rig import Mount
from trocar.services.runtime.errors import ConfigError

WRITTEN = 0.01  # N or N m: little for every device
SOON_S = 1.0  # a drive is asked and answers
WITHIN_M, WITHIN_RAD = 1.0, math.pi


class Subject:
    """A driver on its bench, exchanged with as the gateway does."""

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        self.place = Place("left", Mount(centre_m=(0.04, -0.03, 0.03)), clock=bench.clock)
        self.device = self.load(bench.settings)

    def load(self, settings: driver.DriverSettings) -> Arm | GraspHandle:
        try:
            return drivers.load_arm(settings, self.place)
        except ConfigError as error:
            if "drives something else" not in str(error):
                raise
            return drivers.load_grasp(settings, self.place)

    def read_and_write(self, written: float) -> np.ndarray:
        """Do what the gateway does with it in a tick; return what was read."""
        device, now_ns = self.device, self.bench.clock.monotonic_ns()
        if isinstance(device, Arm):
            read = np.zeros(servo_arrays.READ_SIZE)
            read[: servo_arrays.READ_TEMPERATURE] = np.nan  # position and velocity must be written
            device.read(now_ns, read)
            device.write(np.array([0.0, 0.0, written]))
        else:
            read = np.full(servo_arrays.HANDLE_SIZE, np.nan)
            device.read(now_ns, read)
            device.write(written)
        return read

    def exchange(self, written: float) -> np.ndarray:
        read = self.read_and_write(written)
        self.bench.clock.sleep(TICK_S)
        return read

    def exchange_until(self, condition: Callable[[], bool], written: float) -> bool:
        patience_s = SOON_S if isinstance(self.bench.clock, SteppedClock) else PATIENCE_S
        until_ns = self.bench.clock.monotonic_ns() + round(1e9 * patience_s)
        while self.bench.clock.monotonic_ns() < until_ns:
            self.exchange(written)
            if condition():
                return True
        return False

    def output(self) -> float:
        return self.bench.output(self.device)


@pytest.fixture(params=drivers.known_drivers())
def subject(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Subject]:
    try:
        with open_bench(request.param, tmp_path) as bench:
            yield Subject(bench)
    except BenchUnavailable as reason:
        pytest.skip(str(reason))


@pytest.fixture
def opened(subject: Subject) -> Iterator[Subject]:
    try:
        subject.device.open()
        yield subject
    finally:
        subject.device.close()


def test_what_is_read_is_a_pose_in_si_units(opened: Subject) -> None:
    device = opened.device
    device.enable()
    for read in [opened.exchange(0.0) for _ in range(200)]:
        assert np.isfinite(read).all()
        if isinstance(device, Arm):
            assert np.abs(read[servo_arrays.READ_POSITION :][:3]).max() < WITHIN_M
            assert np.linalg.norm(read[servo_arrays.READ_VELOCITY :][:3]) < device.limits.max_velocity_m_s
        else:
            assert abs(read[servo_arrays.HANDLE_ANGLE]) < WITHIN_RAD


def test_force_is_off_until_enabled_then_as_written_and_gone_after_close(opened: Subject) -> None:
    device = opened.device
    for _ in range(100):
        opened.exchange(WRITTEN)
        assert opened.output() == 0.0, "it pushes before it was enabled"
    device.enable()
    device.enable()
    expected = WRITTEN if device.has_force else 0.0
    assert opened.exchange_until(lambda: opened.output() == pytest.approx(expected, rel=0.1), WRITTEN), (
        f"{WRITTEN} was written, {opened.output()} is applied"
    )
    device.close()
    opened.bench.clock.sleep(5 * TICK_S)
    assert opened.output() == 0.0, "it pushes after it was closed"


@pytest.mark.parametrize("written", [math.nan, math.inf, -math.inf, 1e9, -1e9, 1e308])
def test_what_no_hand_may_get_ends_at_the_drivers_edge(opened: Subject, written: float) -> None:
    device = opened.device
    limit = device.limits.max_force_n if isinstance(device, Arm) else device.max_torque_nm
    device.enable()
    opened.exchange_until(lambda: opened.output() != 0.0 or not device.has_force, WRITTEN)
    for _ in range(20):
        opened.exchange(written)
        assert math.isfinite(opened.output())
        assert abs(opened.output()) <= (1.0 + 1e-6) * limit
        if not math.isfinite(written):
            opened.exchange(written)
    if not math.isfinite(written) and isinstance(opened.bench.clock, SteppedClock):
        assert opened.output() == pytest.approx(0.0, abs=WRITTEN / 2)


def test_an_arm_evaluates_the_law_and_one_with_a_servo_of_its_own_applies_it(opened: Subject) -> None:
    arm = opened.device
    if not isinstance(arm, Arm):
        return
    model, limits = np.zeros(MODEL_COLUMNS), np.ones(servo_arrays.LIMIT_SIZE)
    model[MODEL_F0 + 2], limits[servo_arrays.LIMIT_RATE] = WRITTEN, 200.0
    now, memory = np.zeros(servo_arrays.NOW_SIZE), np.zeros(servo_arrays.MEMORY_SIZE)
    now[servo_arrays.NOW_TTL], now[servo_arrays.NOW_GAIN], now[servo_arrays.NOW_DT] = 0.02, 1.0, TICK_S
    arm.enable()
    for _ in range(round(SOON_S / TICK_S)):
        arm.read(opened.bench.clock.monotonic_ns(), np.zeros(servo_arrays.READ_SIZE))
        arm.evaluate(model, np.zeros(6), limits, now, memory)
        opened.bench.clock.sleep(TICK_S)
    np.testing.assert_allclose(memory[servo_arrays.MEMORY_FORCE :][:3], [0.0, 0.0, WRITTEN])
    assert opened.output() == pytest.approx(WRITTEN if arm.own_servo else 0.0)


def test_a_device_on_its_bench_has_no_fault_also_after_arming_anew(opened: Subject) -> None:
    device = opened.device
    device.enable()
    for _ in range(round(SOON_S / TICK_S)):
        opened.exchange(WRITTEN)
    device.clear_fault()
    # A busy host may have kept a drive's own process from speaking.
    assert opened.exchange_until(lambda: device.fault == "", WRITTEN), device.fault
    if isinstance(device, GraspHandle):
        assert opened.exchange_until(lambda: device.ready == device.has_force, WRITTEN)


def test_reading_and_writing_never_wait(opened: Subject, monkeypatch: pytest.MonkeyPatch) -> None:
    opened.device.enable()
    opened.exchange(WRITTEN)
    for clock in (time, opened.bench.clock):
        monkeypatch.setattr(clock, "sleep", lambda _seconds: pytest.fail("it sleeps in a tick"))
    opened.read_and_write(WRITTEN)
    monkeypatch.undo()


def test_before_open_and_after_close_a_driver_is_harmless(subject: Subject) -> None:
    subject.device.close()
    subject.device.open()
    subject.device.enable()
    subject.exchange(WRITTEN)
    subject.device.close()
    for _ in range(100):
        subject.exchange(WRITTEN)
    assert subject.output() == 0.0
    subject.device.close()


def test_an_unknown_setting_is_refused_by_name(subject: Subject) -> None:
    settings = subject.bench.settings
    spoiled = settings.model_copy(update={"settings": {**settings.settings, "colour": 1}})
    with pytest.raises(ConfigError, match=rf"instrument 'left', driver '{settings.driver}': colour: unknown key"):
        subject.load(spoiled)


def test_what_a_device_can_bear_is_positive(subject: Subject) -> None:
    device = subject.device
    limits = astuple(device.limits) if isinstance(device, Arm) else (device.max_torque_nm,)
    assert all(math.isfinite(limit) and limit > 0.0 for limit in limits)
