"""Arms of Force Dimension and their grippers on a stand-in of the vendor's library, in real time."""

from __future__ import annotations

import ctypes
import math
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.gateway.devices.bench import BenchUnavailable
from tests.gateway.devices.dhd_library import DhdStandIn
from tests.gateway.kicks import kicks_n
from tests.patience import PATIENCE_S
from trocar.protocol.topics import TICK_S
from trocar.services.gateway.devices.driver import Place
from trocar.services.gateway.devices.limited_force import SPARE_S
from trocar.services.gateway.dhd import host_checks
from trocar.services.gateway.dhd.library import DhdState
from trocar.services.gateway.drivers import check_host, load_arm, load_grasp
from trocar.services.gateway.servo import servo_arrays
from trocar.services.gateway.servo.servo_law import MAX_STEP_S
from trocar.services.runtime.config.rig import DriverSettings, Mount
from trocar.services.runtime.errors import DeviceError

RATE_N_S = 200.0
PUSH = np.array([0.5, -0.3, 1.0])
GRIP_MOST_N, GRIP_N = 8.0, 6.0


class DhdBench:
    """An arm, and perhaps its gripper, exchanged with as the gateway does."""

    def __init__(self, standin: DhdStandIn) -> None:
        self.standin = standin
        self.arm = self.new_arm()
        self.grasp = load_grasp(self.settings("grasp_force_dimension", "grasp_omega_7"), self.place)
        self.reading = np.zeros(servo_arrays.READ_SIZE)
        self.handle = np.zeros(servo_arrays.HANDLE_SIZE)
        self.has_grasp = False

    place = Place("left", Mount(), force_rate_n_s=RATE_N_S)

    @property
    def grip_rate_n_s(self) -> float:
        """Limit at the fingers."""
        return self.place.torque_rate_nm_s * GRIP_MOST_N / self.grasp.max_torque_nm

    def settings(self, driver: str, device: str, **own: Any) -> DriverSettings:
        own.setdefault("library", str(self.standin.path))
        return DriverSettings(driver=driver, device=device, settings=own)

    def new_arm(self, device: str = "omega_7", **own: Any) -> Any:
        return load_arm(self.settings("force_dimension", device, **own), self.place)

    def open(self, grasp: bool = False) -> None:
        self.arm.open()
        self.has_grasp = grasp
        if grasp:
            self.grasp.open()
            self.grasp.enable()
        self.arm.enable()

    def run(self, ticks: int, force: np.ndarray = PUSH, torque_nm: float = 0.0) -> None:
        for _ in range(ticks):
            self.arm.read(time.monotonic_ns(), self.reading)
            self.arm.write(force)
            if self.has_grasp:
                self.grasp.read(time.monotonic_ns(), self.handle)
                self.grasp.write(torque_nm)
            time.sleep(TICK_S)

    def until(self, condition: Callable[[], bool], force: np.ndarray = PUSH, torque_nm: float = 0.0) -> None:
        end_s = time.monotonic() + min(PATIENCE_S, 30.0)
        while not condition():
            assert time.monotonic() < end_s, f"arm: {self.arm.fault} {self.arm.prompt}; grasp: {self.grasp.fault}"
            self.run(1, force, torque_nm)

    def pushes(self, force: np.ndarray = PUSH) -> bool:
        return bool(np.allclose(self.standin.force(), force))

    def close(self) -> None:
        self.standin.c.standin_hang(0)
        self.arm.close()
        self.grasp.close()


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[DhdBench]:
    try:
        with DhdStandIn.compiled(tmp_path) as standin:
            built = DhdBench(standin)
            try:
                yield built
                if len(standin.log()) > 1:
                    assert kicks_n(standin.log()).max() <= RATE_N_S * (MAX_STEP_S + SPARE_S) + 1e-9  # rounding
                    most_n = built.grip_rate_n_s * (MAX_STEP_S + SPARE_S)
                    assert kicks_n(standin.grip_log()).max() <= most_n + 1e-9
            finally:
                built.close()
    except BenchUnavailable as reason:
        pytest.skip(str(reason))


def test_place_force_roll_and_buttons_are_those_of_the_library(bench: DhdBench) -> None:
    bench.standin.c.standin_place(0, 0.02, 0.01, 0.03)
    bench.standin.c.standin_turn(0, ctypes.c_double(0.7))
    bench.standin.c.standin_press(0, 5)
    bench.open()
    bench.until(lambda: bench.pushes() and math.isclose(bench.reading[servo_arrays.READ_ROLL], 0.7))
    np.testing.assert_allclose(bench.reading[:3], [0.02, 0.01, 0.03])
    assert bench.arm.buttons == 5
    assert bench.standin.c.standin_gravity(0) == 1


def test_an_arm_and_its_gripper_share_one_device_and_each_leaves_the_other_its_force(bench: DhdBench) -> None:
    bench.open(grasp=True)
    lever_m = bench.grasp.max_torque_nm / 8.0
    bench.until(lambda: bench.pushes() and math.isclose(bench.standin.grip_n(), 2.0), torque_nm=2.0 * lever_m)
    assert bench.handle[servo_arrays.HANDLE_ANGLE] == pytest.approx(0.3)
    assert bench.grasp.ready
    bench.standin.c.standin_open(0, -0.4)  # as a left hand's device tells it
    bench.until(lambda: math.isclose(bench.handle[servo_arrays.HANDLE_ANGLE], 0.4))
    bench.arm.close()
    bench.until(
        lambda: math.isclose(bench.standin.grip_n(), 2.0) and not bench.standin.force().any(), torque_nm=2.0 * lever_m
    )
    bench.grasp.close()
    assert bench.standin.grip_n() == 0.0


def test_a_gateway_that_was_busy_takes_neither_arm_nor_gripper_for_silent(bench: DhdBench) -> None:
    bench.open(grasp=True)
    time.sleep(0.5)
    bench.run(1)
    assert bench.arm.fault == bench.grasp.fault == ""
    bench.until(lambda: bench.pushes() and bench.grasp.ready)


def test_an_opening_that_no_gripper_has_is_a_fault_and_not_believed(bench: DhdBench) -> None:
    bench.open(grasp=True)
    bench.standin.c.standin_open(0, math.nan)
    bench.until(lambda: "tells no opening" in bench.grasp.fault)
    assert not bench.grasp.ready
    assert bench.handle[servo_arrays.HANDLE_ANGLE] == pytest.approx(0.3)
    bench.standin.c.standin_open(0, 0.2)
    bench.grasp.clear_fault()
    bench.until(lambda: bench.grasp.ready and math.isclose(bench.handle[servo_arrays.HANDLE_ANGLE], 0.2))


@pytest.mark.parametrize("wrong", [math.nan, math.inf, 70.0])
def test_a_place_that_no_hand_reaches_is_not_believed_and_then_a_fault(bench: DhdBench, wrong: float) -> None:
    bench.open()
    bench.until(bench.pushes)
    bench.standin.c.standin_place(0, wrong, 0.0, 0.0)
    bench.run(50)
    np.testing.assert_array_equal(bench.reading[:6], 0.0)
    bench.until(lambda: "nothing was read of the arm" in bench.arm.fault)
    bench.standin.c.standin_place(0, 0.0, 0.0, 0.0)
    bench.arm.clear_fault()
    bench.until(lambda: bench.pushes() and not bench.arm.fault)


def test_an_arm_that_is_opened_anew_between_two_ticks_gets_its_first_force_with_its_motors_on(bench: DhdBench) -> None:
    """What it was says nothing of what it is: a force before its motors are on would come in one step later."""
    bench.open()
    bench.until(bench.pushes)
    bench.standin.c.standin_place(0, math.inf, 0.0, 0.0)
    bench.until(lambda: bool(bench.arm.fault))
    bench.standin.c.standin_place(0, 0.0, 0.0, 0.0)
    bench.arm.clear_fault()
    time.sleep(0.5)  # it is open before the next tick
    for _ in range(4):
        bench.run(1)
        time.sleep(MAX_STEP_S)
    bench.until(bench.pushes)


def break_down(bench: DhdBench, wrong: int) -> None:
    bench.standin.c.standin_fail(wrong)


def pull_out(bench: DhdBench, wrong: int) -> None:
    bench.standin.c.standin_plug(0, 1 - wrong)


def state(which: DhdState, usual: int) -> Callable[[DhdBench, int], None]:
    return lambda bench, wrong: bench.standin.c.standin_state(0, int(which), 1 - usual if wrong else usual)


FAULTS: dict[str, tuple[Callable[[DhdBench, int], None], str]] = {
    "broken": (break_down, "communication error"),
    "pulled out": (pull_out, "communication error"),
    "unplugged": (state(DhdState.CONNECTED, 1), "the arm is not plugged in"),
    "without power": (state(DhdState.POWER, 1), "the arm has no power: plug in its supply"),
    "in error": (state(DhdState.ERROR, 0), "the arm reports an error"),
    "uncalibrated": (state(DhdState.CALIBRATED, 1), "the arm has lost its calibration"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_an_arm_that_is_lost_is_a_fault_until_it_is_back_and_a_person_arms_the_rig(bench: DhdBench, name: str) -> None:
    change, said = FAULTS[name]
    bench.open()
    bench.until(bench.pushes)
    change(bench, 1)
    bench.until(lambda: said in bench.arm.fault)
    change(bench, 0)
    bench.arm.clear_fault()
    bench.until(lambda: bench.pushes() and not bench.arm.fault)


def test_a_call_that_hangs_keeps_no_tick_waiting(bench: DhdBench) -> None:
    bench.open()
    bench.until(bench.pushes)
    bench.standin.c.standin_hang(1500)
    bench.run(30)  # each a millisecond or some more; the calls take seconds
    assert bench.arm._link.outstanding == 1
    now_ns = time.monotonic_ns()
    assert bench.arm.write_span_ns(now_ns, now_ns) > 1_000_000 * servo_arrays.FLIGHTS
    bench.standin.c.standin_hang(0)
    bench.until(lambda: bench.arm._link is None or bench.arm._link.outstanding == 0 or bool(bench.arm.fault))
    bench.arm.clear_fault()
    bench.until(lambda: bench.pushes() and not bench.arm.fault)


def test_a_gateway_that_stands_still_leaves_no_force(bench: DhdBench) -> None:
    bench.open()
    bench.until(bench.pushes)
    end_s = time.monotonic() + 10.0
    while bench.standin.force().any():
        assert time.monotonic() < end_s
        time.sleep(0.01)
    bench.until(bench.pushes)


def test_a_force_button_that_is_not_pressed_is_asked_for(bench: DhdBench) -> None:
    bench.open()
    bench.until(bench.pushes)
    bench.standin.c.standin_state(0, int(DhdState.FORCE), 0)
    bench.until(lambda: bench.arm.prompt == "the arm bears no force: press its force button")
    assert bench.arm.fault == ""


SHORT: dict[str, Callable[[DhdBench, int], None]] = {
    "its force button": lambda bench, off: bench.standin.c.standin_state(0, int(DhdState.FORCE), 1 - off),
    "its power": state(DhdState.POWER, 1),
    "its plug": pull_out,
    "all calls": break_down,
}


@pytest.mark.parametrize("name", SHORT)
def test_what_fails_for_a_moment_comes_back_without_a_kick(bench: DhdBench, name: str) -> None:
    bench.open()
    for ticks in (25, 60):
        bench.until(bench.pushes)
        SHORT[name](bench, 1)
        bench.run(ticks)
        assert not bench.standin.force().any()
        SHORT[name](bench, 0)
        bench.run(5)
    bench.until(bench.pushes)
    assert bench.arm.fault == ""


def test_an_arm_whose_motors_are_off_bears_no_force_as_it_is_ordered(bench: DhdBench) -> None:
    bench.arm.open()
    bench.run(40, np.zeros(3))
    late = 0
    for _ in range(50):
        bench.run(1, np.zeros(3))
        now_ns = time.monotonic_ns()
        late += bench.arm.write_span_ns(now_ns, now_ns) > 1_000_000 * servo_arrays.FLIGHTS
    assert late < 50, "the law would never let a force through"


@pytest.mark.parametrize("name", SHORT)
def test_so_does_the_force_of_a_gripper(bench: DhdBench, name: str) -> None:
    torque_nm = GRIP_N / GRIP_MOST_N * bench.grasp.max_torque_nm
    bench.open(grasp=True)
    for ticks in (25, 60):
        bench.until(lambda: math.isclose(bench.standin.grip_n(), GRIP_N), torque_nm=torque_nm)
        SHORT[name](bench, 1)
        bench.run(ticks, torque_nm=torque_nm)
        assert bench.standin.grip_n() == 0.0
        assert not bench.grasp.ready, "the law must know, as its torque is not given"
        SHORT[name](bench, 0)
    bench.until(lambda: math.isclose(bench.standin.grip_n(), GRIP_N), torque_nm=torque_nm)
    assert bench.grasp.ready


@pytest.mark.parametrize("hang_ms", [2, 8, 30])
def test_nor_is_a_gripper_kicked_by_calls_that_hang(bench: DhdBench, hang_ms: int) -> None:
    torque_nm = GRIP_N / GRIP_MOST_N * bench.grasp.max_torque_nm
    bench.open(grasp=True)
    for _ in range(3):
        bench.until(lambda: math.isclose(bench.standin.grip_n(), GRIP_N), torque_nm=torque_nm)
        bench.run(5)
        bench.standin.c.standin_hang(hang_ms)
        bench.run(60, torque_nm=torque_nm)
        bench.standin.c.standin_hang(0)
    bench.until(lambda: math.isclose(bench.standin.grip_n(), GRIP_N), torque_nm=torque_nm)


def test_a_gripper_of_a_gateway_that_stands_still_rises_from_none(bench: DhdBench) -> None:
    torque_nm = GRIP_N / GRIP_MOST_N * bench.grasp.max_torque_nm
    bench.open(grasp=True)
    bench.until(lambda: math.isclose(bench.standin.grip_n(), GRIP_N), torque_nm=torque_nm)
    end_s = time.monotonic() + 10.0
    while bench.standin.grip_n():
        assert time.monotonic() < end_s
        time.sleep(0.01)
    bench.until(lambda: math.isclose(bench.standin.grip_n(), GRIP_N), torque_nm=torque_nm)


def test_of_two_arms_one_is_to_be_named_by_its_serial_number(bench: DhdBench) -> None:
    bench.standin.c.standin_reset(2)
    with pytest.raises(DeviceError, match=r"instrument 'left': several arms are plugged in \(100, 101\): name one"):
        bench.arm.open()
    with pytest.raises(DeviceError, match=r"there is no arm with serial number 7; there are: 100, 101"):
        bench.new_arm(serial=7).open()
    bench.arm = bench.new_arm(serial=101)
    bench.open()
    bench.until(lambda: bool(np.allclose(bench.standin.force(1), PUSH)))
    assert not bench.standin.force(0).any()


def test_an_arm_of_two_instruments_is_refused(bench: DhdBench) -> None:
    bench.open()
    second = bench.new_arm()
    with pytest.raises(DeviceError, match="another instrument has this arm: name each by its `serial`"):
        second.open()
    second.close()
    bench.until(bench.pushes)


def test_a_gripper_keeps_its_device_though_its_arm_could_not_be_opened_anew(bench: DhdBench) -> None:
    bench.open(grasp=True)
    bench.until(bench.pushes)
    pull_out(bench, 1)
    bench.until(lambda: bool(bench.arm.fault and bench.grasp.fault))
    bench.arm.clear_fault()
    bench.until(lambda: "can be opened" in bench.arm.fault)
    pull_out(bench, 0)
    bench.grasp.clear_fault()
    bench.until(lambda: bench.grasp.ready)
    bench.arm.close()
    bench.until(lambda: bench.grasp.ready and not bench.grasp.fault)
    bench.run(300)
    assert bench.grasp.ready


def test_an_arm_of_another_model_than_its_device_file_is_refused(bench: DhdBench) -> None:
    with pytest.raises(DeviceError, match=r"the arm is a omega\.7, its device file is of delta\.3: name the file"):
        bench.new_arm("delta_3").open()


def test_an_arm_without_gripper_says_so(bench: DhdBench) -> None:
    bench.standin.c.standin_gripper(0, 0)
    with pytest.raises(DeviceError, match=r"instrument 'left': the gripper's omega\.7 has no gripper"):
        bench.grasp.open()


def test_no_device_and_no_library_are_one_sentence_each(bench: DhdBench) -> None:
    with pytest.raises(
        DeviceError, match=r"'left': Force Dimension's DHD cannot be loaded: libdhd-that-nobody-has\.so"
    ):
        bench.new_arm(library="libdhd-that-nobody-has.so").open()
    with pytest.raises(DeviceError, match=r"'left': libm\.so\.6 is no DHD of version 3\.7 or newer"):
        bench.new_arm(library="libm.so.6").open()
    bench.standin.c.standin_plug(0, 0)
    with pytest.raises(DeviceError, match=r"no arm of Force Dimension or Novint can be opened: no device found"):
        bench.arm.open()


def test_the_host_check_tells_library_devices_and_permissions(bench: DhdBench, tmp_path: Path) -> None:
    device = tmp_path / "sys/bus/usb/devices/1-1"
    device.mkdir(parents=True)
    texts = {"idVendor": "1451", "idProduct": "0402", "product": "omega.7", "busnum": "1", "devnum": "4"}
    for name, text in texts.items():
        (device / name).write_text(text + "\n")
    found = {check.name: check for check in host_checks.check("no-such.so", [None], False, tmp_path)}
    assert not found["Force Dimension's DHD"].ok
    assert found["arms plugged in"].found == "omega.7"
    assert "dev/bus/usb/001/004" in found["arms' permissions"].found
    assert "71-trocar-force-dimension.rules" in found["arms' permissions"].advice
    settings = [bench.settings("force_dimension", "omega_7")]
    assert {check.name for check in check_host(settings, in_use=True)} == {"Force Dimension's DHD", "arms plugged in"}
