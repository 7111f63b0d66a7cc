"""What single drivers do beyond the contract, and what a person is told when one cannot be had."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import can
import numpy as np
import pytest

from tests.gateway.can.virtual_node import VirtualNode
from trocar.services.gateway import drivers
from trocar.services.gateway.can import canbus, cansimple
from trocar.services.gateway.can.cansimple import AxisError, AxisState
from trocar.services.gateway.devices.device_files import GraspFile
from trocar.services.gateway.devices.driver import Arm, Place
from trocar.services.gateway.servo import servo_arrays
from trocar.services.gateway.simulated.emulated_drive import ENCODER_COUNTS
from trocar.services.runtime.config import config
from trocar.services.runtime.config.rig import DriverSettings, Mount
from trocar.services.runtime.errors import ConfigError, DeviceError, MissingPackageError

PLACE = Place("left", Mount(centre_m=(0.04, -0.03, 0.03)))
TICK_NS = 1_000_000


def _arm() -> Arm:
    settings = DriverSettings(driver="phantom_simulated", device="phantom_premium_1_5", settings={"script": "stroke"})
    return drivers.load_arm(settings, PLACE)


def test_an_unknown_driver_is_told_with_the_known_ones() -> None:
    with pytest.raises(ConfigError, match=r"no driver 'phantom'; known: .*phantom_simulated"):
        drivers.load_arm(DriverSettings(driver="phantom"), PLACE)


def test_a_handle_is_no_arm() -> None:
    with pytest.raises(ConfigError, match="'left', arm: driver 'grasp_simulated' drives something else"):
        drivers.load_arm(DriverSettings(driver="grasp_simulated"), PLACE)


def test_a_missing_library_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "trocar.services.gateway.drivers.grasp_odrive_can")
    monkeypatch.setitem(sys.modules, "can", None)
    with pytest.raises(MissingPackageError, match="'left': driver 'grasp_odrive_can' needs the package 'can': "):
        drivers.load_grasp(DriverSettings(driver="grasp_odrive_can"), PLACE)


def test_drivers_load_only_what_is_named() -> None:
    code = "import sys, trocar.services.gateway.devices.driver; sys.exit('can' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_device_file_is_asked_for() -> None:
    with pytest.raises(ConfigError, match="'phantom_simulated' needs a `device` file"):
        drivers.load_arm(DriverSettings(driver="phantom_simulated"), PLACE)


def test_a_stall_of_the_gateway_is_not_a_fast_hand() -> None:
    reading = np.zeros(servo_arrays.READ_SIZE)
    arm = _arm()
    arm.open()
    arm.enable()
    speeds = []
    # One in two hundred ticks comes 15 ms late: the hand of the script never moves faster than 0.03 m/s.
    time_ns = 1
    for k in range(2000):
        time_ns += TICK_NS * (15 if k % 200 == 0 else 1)
        arm.read(time_ns, reading)
        speeds.append(float(np.linalg.norm(reading[servo_arrays.READ_VELOCITY : servo_arrays.READ_VELOCITY + 3])))
    assert 0.01 < max(speeds) < 0.06


@pytest.mark.parametrize("begin", ["enable", "go_on"])
def test_a_simulated_hand_begins_with_the_force_or_without_it(begin: str) -> None:
    arm, readings = _arm(), np.zeros((2, servo_arrays.READ_SIZE))
    arm.open()
    for k in range(1000):
        arm.read(1 + k * TICK_NS, readings[0])
    getattr(arm, begin)()
    for k in range(1000, 2000):
        arm.read(1 + k * TICK_NS, readings[1])
    first, last = readings[:, servo_arrays.READ_POSITION : servo_arrays.READ_POSITION + 3]
    assert np.linalg.norm(last - first) > 1e-3


class Odrive:
    """The CAN driver on an in-process bus with an emulated drive."""

    def __init__(self, channel: str) -> None:
        self.node = VirtualNode(channel)
        bus = {"interface": "virtual", "channel": channel}
        settings = DriverSettings(driver="grasp_odrive_can", device="grasp_odrive", settings={"bus": bus})
        self.grasp = drivers.load_grasp(settings, replace(PLACE, clock=self.node.clock))
        self.host = can.Bus(interface="virtual", channel=channel)

    def run(self, seconds: float, torque_nm: float = 0.0, write: bool = True) -> float:
        handle = np.zeros(2)
        for _ in range(round(seconds / 1e-3)):
            self.node.advance()
            self.grasp.read(0, handle)
            if write:
                self.grasp.write(torque_nm)
        return float(handle[servo_arrays.HANDLE_ANGLE])

    def estop(self) -> None:
        frame = can.Message(arbitration_id=cansimple.identifier(1, cansimple.ESTOP), is_extended_id=False)
        self.host.send(frame)

    def close(self) -> None:
        self.grasp.close()
        self.host.shutdown()
        self.node.close()


@pytest.fixture
def odrive(tmp_path: Path) -> Iterator[Odrive]:
    bench = Odrive(str(tmp_path))
    bench.grasp.open()
    yield bench
    bench.close()


def test_a_handle_is_measured_before_and_loaded_only_after_it_is_enabled(odrive: Odrive) -> None:
    assert odrive.run(0.2, torque_nm=0.1) == pytest.approx(0.5, abs=0.01)
    assert odrive.node.drive.applied_nm == 0.0
    assert not odrive.grasp.ready
    odrive.grasp.enable()
    angle = odrive.run(0.5, torque_nm=0.1)
    assert odrive.grasp.ready
    assert angle == pytest.approx(0.55, abs=0.01)


def test_closing_leaves_the_drive_idle_without_torque(odrive: Odrive) -> None:
    odrive.grasp.enable()
    odrive.run(0.3, torque_nm=0.1)
    odrive.grasp.close()
    odrive.node.advance()
    assert (odrive.node.drive.state, odrive.node.drive.torque_nm) == (AxisState.IDLE, 0.0)


def test_a_watchdog_disarm_ends_with_the_next_engagement(odrive: Odrive) -> None:
    odrive.grasp.enable()
    odrive.run(0.3, torque_nm=0.1)
    odrive.run(0.3, write=False)
    assert odrive.node.drive.errors == AxisError.WATCHDOG_TIMER_EXPIRED
    odrive.run(0.2)
    assert "WATCHDOG_TIMER_EXPIRED" in odrive.grasp.fault
    assert not odrive.grasp.ready
    odrive.grasp.enable()
    odrive.run(0.3)
    assert odrive.grasp.ready
    assert odrive.grasp.fault == ""


def test_an_estop_stays_until_a_person_arms_the_rig(odrive: Odrive) -> None:
    odrive.grasp.enable()
    odrive.run(0.3, torque_nm=0.1)
    odrive.estop()
    odrive.run(0.2, torque_nm=0.1)
    odrive.grasp.enable()
    odrive.run(0.3, torque_nm=0.1)
    assert odrive.node.drive.applied_nm == 0.0
    assert "ESTOP_REQUESTED" in odrive.grasp.fault
    odrive.grasp.clear_fault()
    odrive.run(0.3, torque_nm=0.1)
    assert odrive.grasp.ready


def test_a_silent_drive_is_not_ready_and_named(odrive: Odrive) -> None:
    odrive.grasp.enable()
    odrive.run(0.3)
    odrive.node.speaking = False
    odrive.run(0.004)
    assert odrive.grasp.ready
    odrive.run(0.002)
    assert not odrive.grasp.ready
    odrive.run(0.31)
    assert "node 1) has been silent" in odrive.grasp.fault


def test_a_drive_that_tells_no_position_is_a_fault_that_says_what_to_do(odrive: Odrive) -> None:
    """Its heartbeat comes and its loop is closed: it was half ready for ever."""
    assert odrive.grasp._link is not None
    odrive.grasp._link._estimates_id = -1  # none of the drive's messages is one
    odrive.grasp.enable()
    odrive.run(0.7)
    assert not odrive.grasp.ready
    assert "node 1) sends no position" in odrive.grasp.fault


@pytest.mark.parametrize("period_ms", [8, 10, 20, 100, 250])
def test_a_drive_that_tells_its_position_too_seldom_is_a_fault_too(odrive: Odrive, period_ms: int) -> None:
    """It was ready for the half of the time, without a word."""
    link = odrive.grasp._link
    assert link is not None
    odrive.grasp.enable()
    odrive.run(0.3)
    assert odrive.grasp.ready
    take, ready = link._take_estimates, []
    for k in range(1000):
        link._take_estimates = take if k % period_ms == 0 else lambda _data: None  # type: ignore[method-assign]
        odrive.run(0.001)
        ready.append(odrive.grasp.ready)
    assert not any(ready[30:])
    assert "less often than every 5 ms" in odrive.grasp.fault
    link._take_estimates = take  # type: ignore[method-assign]
    odrive.run(0.3)
    assert odrive.grasp.ready


@pytest.mark.parametrize("turns_s", [50.0, -1e30])
def test_a_speed_that_no_handle_has_is_a_fault(odrive: Odrive, turns_s: float) -> None:
    odrive.grasp.enable()
    odrive.run(0.3)
    assert odrive.grasp._link is not None
    odrive.grasp._link.rate_turns_s = turns_s
    handle = np.ones(2)
    odrive.grasp.read(0, handle)
    assert "which no hand can make" in odrive.grasp.fault
    assert handle[1] == 0.0
    assert not odrive.grasp.ready


@pytest.mark.parametrize("turns", [0.5, 9.0, -0.4, 1e30])
def test_an_angle_that_no_hand_can_make_is_a_fault_with_a_sentence_and_no_angle(odrive: Odrive, turns: float) -> None:
    """A wrong zero, a gear that is not as the file says, an encoder that slipped: jaws would turn through."""
    odrive.grasp.enable()
    odrive.run(0.3, torque_nm=0.1)
    odrive.node.speaking = False
    estimates = cansimple.identifier(1, cansimple.GET_ENCODER_ESTIMATES)
    for _ in range(5):
        data = cansimple.pack_floats(turns, 0.0)
        odrive.host.send(can.Message(arbitration_id=estimates, data=data, is_extended_id=False))
        assert odrive.run(0.001) == pytest.approx(0.5, abs=0.06), "it is where it was"
    assert not odrive.grasp.ready
    assert "node 1) says that its handle is at" in odrive.grasp.fault
    assert "shut_at_motor_turns" in odrive.grasp.fault
    odrive.node.speaking = True
    odrive.run(0.3)
    assert odrive.grasp.fault == ""
    assert odrive.grasp.ready


def test_a_drive_whose_angle_jumps_is_not_ready_and_keeps_its_fault(odrive: Odrive) -> None:
    """Every other estimate is likely: it was ready in every other tick."""
    odrive.grasp.enable()
    odrive.run(0.3)
    odrive.node.speaking = False
    estimates, ready, faults = cansimple.identifier(1, cansimple.GET_ENCODER_ESTIMATES), [], []
    for k in range(60):
        data = cansimple.pack_floats(3.0 if k % 2 == 0 else 0.1, 0.0)
        odrive.host.send(can.Message(arbitration_id=estimates, data=data, is_extended_id=False))
        odrive.run(0.001)
        ready.append(odrive.grasp.ready)
        faults.append("which no hand can make" in odrive.grasp.fault)
    assert not any(ready[2:])
    assert all(faults[2:])


def test_own_echoes_strange_frames_and_lies_are_not_believed(odrive: Odrive) -> None:
    odrive.grasp.enable()
    odrive.run(0.3)
    estimates = cansimple.identifier(1, cansimple.GET_ENCODER_ESTIMATES)
    nan = cansimple.pack_floats(float("nan"), 0.0)
    for data, options in (
        (b"\1\2", {}),
        (nan, {}),
        (cansimple.pack_floats(9.0, 9.0), {"is_extended_id": True}),
        (b"", {"is_remote_frame": True}),
    ):
        odrive.host.send(can.Message(arbitration_id=estimates, data=data, **({"is_extended_id": False} | options)))
    assert odrive.run(0.1) == pytest.approx(0.5, abs=0.01)


def test_gear_direction_and_zero_of_the_device_file_count(tmp_path: Path) -> None:
    node = VirtualNode(str(tmp_path))
    usual = config.load(GraspFile, config.find("device", "grasp_odrive"))[0]
    changed = {"motor_turns_per_handle_turn": 4.0, "opens_with_positive_motor": False, "shut_at_motor_turns": 0.2}
    file = tmp_path / "geared.yaml"
    file.write_text(json.dumps({**usual.model_dump(), **changed}))
    bus = {"interface": "virtual", "channel": str(tmp_path)}
    settings = DriverSettings(driver="grasp_odrive_can", device=str(file), settings={"bus": bus})
    grasp = drivers.load_grasp(settings, replace(PLACE, clock=node.clock))
    grasp.open()
    grasp.enable()
    handle = np.zeros(2)
    node.advance(0.2)
    grasp.write(0.1)
    grasp.read(0, handle)  # passes over what has piled up
    node.advance()
    grasp.read(0, handle)
    assert node.drive.torque_nm == pytest.approx(-0.1 / 4.0)
    turns = node.drive.handle.angle_rad / (2 * math.pi)
    half_a_count = math.pi / ENCODER_COUNTS / 4.0 + 1e-6
    assert handle[servo_arrays.HANDLE_ANGLE] == pytest.approx(-(turns - 0.2) * 2 * math.pi / 4.0, abs=half_a_count)
    grasp.close()
    node.close()


def test_no_drive_on_the_bus_is_one_sentence(tmp_path: Path) -> None:
    bench = Odrive(str(tmp_path))
    bench.node.speaking = False
    with pytest.raises(DeviceError, match=r"instrument 'left': no heartbeat of node 1 within 3 s"):
        bench.grasp.open()
    bench.close()


@pytest.mark.parametrize(
    ("bus", "sentence"),
    [
        ({"interface": "nosuch", "channel": "x"}, "CAN bus nosuch x cannot be opened"),
        ({"interface": "socketcan", "channel": "nocan0"}, "CAN bus socketcan nocan0 cannot be opened"),
    ],
)
def test_a_bus_that_is_not_there_is_one_sentence(bus: dict[str, Any], sentence: str) -> None:
    with pytest.raises(DeviceError, match=sentence) as caught:
        canbus.open_bus(bus, "instrument 'left'")
    assert "\n" not in str(caught.value)


def _read(arm: Arm, from_ns: int, ticks: int) -> np.ndarray:
    """Return the readings of so many ticks."""
    reading, found = np.zeros(servo_arrays.READ_SIZE), []
    for k in range(ticks):
        arm.read(from_ns + k * TICK_NS, reading)
        found.append(reading.copy())
    return np.array(found)


def test_a_simulated_arm_that_begins_again_does_what_it_did_once_force_begins() -> None:
    arm = _arm()
    arm.open()
    place = slice(servo_arrays.READ_POSITION, servo_arrays.READ_VELOCITY)
    velocity = slice(servo_arrays.READ_VELOCITY, servo_arrays.READ_VELOCITY + 3)
    waits = _read(arm, TICK_NS, 50)
    arm.enable()
    first = _read(arm, 51 * TICK_NS, 900)
    assert np.linalg.norm(first[-1, place] - waits[-1, place]) > 5e-3
    arm.begin_again()
    back = _read(arm, 951 * TICK_NS, 50)
    assert np.abs(back[:, place] - waits[:, place]).max() < 1e-3
    assert np.abs(back[:, velocity]).max() < 0.1, "no arm moves so fast as to be put back"
    arm.enable()
    assert np.abs(_read(arm, 1001 * TICK_NS, 900)[:, place] - first[:, place]).max() < 1e-3
