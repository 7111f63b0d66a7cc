from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from tests.gateway.kicks import ENDLESS_N
from trocar.protocol import Frame, decode, encode
from trocar.protocol.bodies import GatewayState, LocalModel
from trocar.services.gateway.devices.driver import Arm, ArmLimits, GraspHandle
from trocar.services.gateway.instruments import instrument
from trocar.services.gateway.instruments.instrument import Instrument
from trocar.services.gateway.instruments.servo import Servo, ServoLimits
from trocar.services.gateway.servo.servo_arrays import HANDLE_ANGLE, READ_POSITION, READ_ROLL
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.runtime.config.rig import DriverSettings, InstrumentSettings, Mount

TICK_NS = 1_000_000


class FakeArm(Arm):
    limits = ArmLimits(3.0, 1.0, 1.2, 30e-6, 0.04)

    def __init__(self) -> None:
        self.enabled = 0
        self.went_on = False
        self.written = np.zeros(3)

    def open(self) -> None:
        self.calibrated = True

    def enable(self) -> None:
        self.enabled += 1

    def go_on(self) -> None:
        self.went_on = True

    def read(self, time_ns: int, reading: FloatArray) -> None:
        reading[READ_POSITION] = 0.01
        reading[READ_ROLL] = 0.3

    def write(self, force_n: FloatArray) -> None:
        self.written[:] = force_n

    def close(self) -> None:
        self.written[:] = 0.0


class FakeGrasp(GraspHandle):
    max_torque_nm = 0.3

    def __init__(self) -> None:
        self.written_nm = 0.0
        self.is_open = False

    def open(self) -> None:
        self.is_open = True

    def enable(self) -> None:
        self.ready = True

    def read(self, time_ns: int, handle: FloatArray) -> None:
        handle[HANDLE_ANGLE] = 0.4

    def write(self, torque_nm: float) -> None:
        self.written_nm = torque_nm

    def close(self) -> None:
        self.is_open = False


class Bench:
    """An instrument of fakes, whose yaw of a quarter turn carries the world's y to the arm's x."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, name: str = "left") -> None:
        self.arm, self.grasp = FakeArm(), FakeGrasp()
        settings = InstrumentSettings(
            name=name, port_m=(0.0, 0.0, 0.1), mount=Mount(yaw_rad=np.pi / 2), arm=DriverSettings(driver="fake")
        )
        self.servo = Servo(ServoLimits(3.0, 1.0, 200.0, 0.3, 1.2, 30e-6, ENDLESS_N), ramp_s=0.01)
        self.instrument = Instrument(settings, self.arm, self.grasp, self.servo)
        self.instrument.open()
        monkeypatch.setattr(instrument, "time", SimpleNamespace(monotonic_ns=lambda: self.now_ns))
        self.now_ns = 1_000_000_000

    def run(self, ticks: int, model: LocalModel) -> None:
        for _ in range(ticks):
            self.servo.accept(np.array(model.row()), 0.02, self.now_ns, 1)
            self.now_ns += TICK_NS
            self.instrument.read(self.now_ns)
            self.instrument.answer(self.now_ns)
            self.instrument.exchange_handle()


FREE = LocalModel()
PUSH = LocalModel(force_n=(0.0, 1.0, 0.0), grasp_torque_nm=0.05, in_contact=True)


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Bench:
    engaged = Bench(monkeypatch)
    engaged.run(200, FREE)
    return engaged


def test_motors_are_switched_on_once_when_force_begins(bench: Bench) -> None:
    assert bench.arm.enabled == 1
    assert bench.grasp.ready


def test_both_devices_are_opened_and_closed(bench: Bench) -> None:
    bench.run(20, PUSH)
    assert bench.grasp.is_open
    assert np.linalg.norm(bench.arm.written) > 0.0
    bench.instrument.close()
    assert not bench.grasp.is_open
    np.testing.assert_array_equal(bench.arm.written, 0.0)
    assert bench.instrument.state().state == "off"


def test_the_first_frame_tells_where_the_handle_is(monkeypatch: pytest.MonkeyPatch) -> None:
    new = Bench(monkeypatch).instrument
    new.warm()
    assert new.state().handle_angle_rad == 0.4


def test_force_goes_to_the_arm_in_its_own_frame(bench: Bench) -> None:
    bench.run(20, PUSH)
    np.testing.assert_allclose(bench.arm.written, (1.0, 0.0, 0.0), atol=1e-12)


def test_the_handle_gets_the_torque_of_its_model(bench: Bench) -> None:
    bench.run(30, LocalModel(grasp_torque_nm=0.05, grasp_stiffness_nm_rad=0.1, in_contact=True))
    assert bench.grasp.written_nm == pytest.approx(0.05 - 0.1 * 0.4)
    assert bench.instrument.state().applied_grasp_torque_nm == bench.grasp.written_nm


def test_a_hand_that_is_refused_force_goes_on_after_a_while(monkeypatch: pytest.MonkeyPatch) -> None:
    """A tool that holds tissue from before the gateway began pulls at it: no force, and a hand that waits for one."""
    bench = Bench(monkeypatch)
    bench.run(round(1000 * instrument.PATIENCE_S), PUSH)
    assert not bench.arm.went_on
    bench.run(5, PUSH)
    assert bench.arm.went_on
    assert bench.arm.enabled == 0
    np.testing.assert_array_equal(bench.arm.written, 0.0)


def test_a_device_without_force_is_never_written(bench: Bench) -> None:
    bench.arm.has_force = False
    bench.run(20, PUSH)
    np.testing.assert_array_equal(bench.arm.written, 0.0)


def test_a_fault_of_one_arm_leaves_the_other_alone(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    other = Bench(monkeypatch, "right")
    other.run(200, FREE)
    for each in (bench, other):
        each.run(20, PUSH)
    bench.arm.fault = "no more encoder counts"
    for each in (bench, other):
        each.run(20, PUSH)
    assert (bench.instrument.state().state, bench.instrument.state().fault) == ("fault", "no more encoder counts")
    np.testing.assert_array_equal(bench.arm.written, 0.0)
    assert other.instrument.state().state == "active"
    np.testing.assert_allclose(other.arm.written, (1.0, 0.0, 0.0), atol=1e-12)


def test_arming_forgets_a_fault_that_is_gone(bench: Bench) -> None:
    bench.arm.fault = "loose plug"
    bench.run(1, FREE)
    bench.instrument.rearm()
    bench.run(200, FREE)
    assert bench.instrument.state().state == "active"


def test_what_is_tried_again_is_what_is_at_fault_and_nothing_else(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    cleared: list[str] = []
    for name, device in (("arm", bench.arm), ("grasp", bench.grasp)):
        monkeypatch.setattr(device, "clear_fault", lambda name=name: cleared.append(name))
    bench.run(20, PUSH)
    bench.instrument.try_again()
    assert cleared == []
    bench.grasp.fault = "silent"
    bench.instrument.try_again()
    assert cleared == ["grasp"]
    bench.run(5, PUSH)
    np.testing.assert_allclose(bench.arm.written, (1.0, 0.0, 0.0), atol=1e-12)
    monkeypatch.undo()
    bench.grasp.fault, bench.arm.fault = "", "loose plug"
    bench.run(1, FREE)
    bench.instrument.try_again()
    monkeypatch.setattr(instrument, "time", SimpleNamespace(monotonic_ns=lambda: bench.now_ns))
    bench.run(200, FREE)
    assert bench.instrument.state().state == "active"


def test_the_state_travels(bench: Bench) -> None:
    bench.run(20, PUSH)
    said = bench.instrument.state()
    frame = Frame(1, "gateway.state", 1, 1, 1, 1, 1, True, GatewayState(tick=1, instruments=(said,)))
    heard = decode(encode(frame)).body.instruments[0]
    assert heard == said
    assert heard.position_m == pytest.approx((0.0, 0.01, 0.0))
    assert (heard.roll_rad, heard.applied_force_n) == (pytest.approx(0.3), pytest.approx((0.0, 1.0, 0.0)))
