"""The ODrive handle on other buses: an slcan adapter on a serial line, UDP multicast, and how busy they are."""

from __future__ import annotations

import re
import time
import tracemalloc
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import can
import numpy as np
import pytest

from tests.gateway.can.slcan_adapter import Adapter
from tests.gateway.can.virtual_node import VirtualNode
from tests.gateway.devices.bench import SteppedClock
from tests.ports import free_port
from trocar.services.gateway import drivers
from trocar.services.gateway.can import canbus
from trocar.services.gateway.can.bus_load import BusLoad, frame_bits
from trocar.services.gateway.can.cansimple import AxisState
from trocar.services.gateway.devices.driver import Place
from trocar.services.gateway.servo import servo_arrays
from trocar.services.runtime.config.rig import DriverSettings, Mount
from trocar.services.runtime.errors import DeviceError

TORQUE_NM = 0.1


class OnSlcan:
    """A drive behind an adapter behind a pseudo terminal, by a name that stays, as those of /dev/serial/by-id."""

    def __init__(self, folder: Path) -> None:
        self.port = folder / "adapter"
        self.adapter = self.plug_in()
        self.node = VirtualNode(self.adapter)
        settings = {"interface": "slcan", "channel": str(self.port), "bitrate": 1_000_000}
        self.grasp = load(settings | {"sleep_after_open": 0.0}, self.node)
        self.handle = np.zeros(2)

    def plug_in(self) -> Adapter:
        adapter = Adapter()
        self.port.unlink(missing_ok=True)
        self.port.symlink_to(adapter.port_name)
        return adapter

    def pull_out(self) -> None:
        self.port.unlink()
        self.adapter.shutdown()

    def run(self, ticks: int, torque_nm: float) -> None:
        for _ in range(ticks):
            self.node.advance()
            self.grasp.read(0, self.handle)
            self.grasp.write(torque_nm)
            self.adapter.hear()

    def run_without(self, ticks: int) -> None:
        """Tick without an adapter, or with one that nobody has opened."""
        for _ in range(ticks):
            self.node.advance()
            self.grasp.read(0, self.handle)
            self.grasp.write(0.0)

    def replug(self) -> None:
        """Plug in another adapter, and switch another drive on behind it: one of which nobody has asked anything."""
        self.adapter = self.plug_in()
        self.node.power_up(self.adapter)

    def arm(self) -> None:
        """Arm the rig and wait until the bus is open, or cannot be: what the kernel takes for it is no time of ours."""
        self.grasp.clear_fault()
        while self.grasp.is_opening:
            time.sleep(1e-3)
        self.grasp.read(0, self.handle)

    def close(self) -> None:
        self.grasp.close()
        self.node.close()


def load(bus: dict[str, Any], node: VirtualNode) -> Any:
    settings = DriverSettings(driver="grasp_odrive_can", device="grasp_odrive", settings={"bus": bus})
    return drivers.load_grasp(settings, replace(Place("left", Mount()), clock=node.clock))


@pytest.fixture
def slcan(tmp_path: Path) -> Iterator[OnSlcan]:
    bench = OnSlcan(tmp_path)
    bench.grasp.found_timeout_s = 300.0  # of the drive's time: the kernel hands on what is written when it likes
    bench.grasp.open()
    bench.adapter.hear()
    yield bench
    bench.close()


def test_a_drive_behind_an_slcan_adapter_is_measured_and_loaded(slcan: OnSlcan) -> None:
    slcan.run(50, 0.0)
    assert slcan.adapter.commands[:2] == ["C", "S"]  # closed, told the bit rate, then opened
    assert slcan.handle[servo_arrays.HANDLE_ANGLE] == pytest.approx(0.5, abs=1e-3)
    slcan.grasp.enable()
    slcan.run(300, TORQUE_NM)
    assert slcan.grasp.ready
    assert slcan.node.drive.applied_nm == pytest.approx(TORQUE_NM)
    assert slcan.handle[servo_arrays.HANDLE_ANGLE] == pytest.approx(0.55, abs=0.01)


def test_what_the_adapter_answers_to_frames_does_not_hide_estimates(slcan: OnSlcan) -> None:
    """A "z" comes for each frame that was sent: an angle is as new as on any other bus all the same."""
    slcan.run(200, 0.0)
    for wanted_rad in np.linspace(0.5, 0.8, 100):
        slcan.node.wanted_rad = float(wanted_rad)
        slcan.run(1, 0.0)
        assert slcan.handle[servo_arrays.HANDLE_ANGLE] == pytest.approx(slcan.node.drive.handle.angle_rad, abs=1e-3)


def test_noise_on_the_serial_line_is_passed_over(slcan: OnSlcan) -> None:
    for line in (b"\a", b"t0", b"t12Z8\r", b"hello\r\r", b"\xff\xfe\r", b"T\r", b"t1239AABB\r"):
        slcan.adapter.say(line)
        slcan.run(1, 0.0)
    slcan.run(5, 0.0)
    assert slcan.handle[servo_arrays.HANDLE_ANGLE] == pytest.approx(0.5, abs=1e-3)


def test_a_line_without_end_is_not_kept() -> None:
    """What another device says at another speed: the adapter's bus would grow by it for as long as the rig runs."""
    adapter = Adapter()
    bus = canbus.open_bus({"interface": "slcan", "channel": adapter.port_name, "sleep_after_open": 0.0}, "a handle")
    tracemalloc.start()
    try:
        for _ in range(200):
            adapter.say(bytes(2000))
            assert bus.recv(0.0) is None
        assert tracemalloc.get_traced_memory()[0] < 100_000
    finally:
        tracemalloc.stop()
    adapter.say(b"\rt0012ABCD\r")
    assert bus.recv(0.0).data == b"\xab\xcd"
    bus.shutdown()
    adapter.shutdown()


def test_an_adapter_that_is_pulled_out_takes_the_torque(slcan: OnSlcan) -> None:
    slcan.grasp.enable()
    slcan.run(300, TORQUE_NM)
    slcan.adapter.shutdown()
    for _ in range(10):
        slcan.node.advance()
        slcan.grasp.read(0, slcan.handle)
        slcan.grasp.write(0.0)
    assert not slcan.grasp.ready
    assert "CAN: the adapter does not listen" in slcan.grasp.fault


def test_an_adapter_that_was_pulled_out_is_taken_up_again_when_the_rig_is_armed(slcan: OnSlcan) -> None:
    """Whether the drive lost its power with it or not: one that did has forgotten that it is to follow torques."""
    slcan.grasp.enable()
    slcan.run(300, TORQUE_NM)
    slcan.pull_out()
    slcan.run_without(400)
    slcan.arm()
    assert re.fullmatch(r"CAN bus slcan \S+/adapter cannot be opened: .+", slcan.grasp.fault), "it is not there yet"
    slcan.replug()
    slcan.run_without(400)
    assert not slcan.grasp.ready, "not by itself"
    slcan.arm()
    slcan.run(300, 0.0)
    assert slcan.grasp.fault == ""
    assert slcan.grasp.ready
    slcan.run(300, TORQUE_NM)
    assert slcan.node.drive.applied_nm == pytest.approx(TORQUE_NM)


class TwoOnSlcan:
    """Two drives on a bus of wires, behind one adapter, and the handles of both instruments."""

    def __init__(self, folder: str) -> None:
        self.adapter, self.wires = Adapter(), can.Bus(interface="virtual", channel=folder)
        self.nodes = VirtualNode(folder), VirtualNode(folder, node=2)
        bus = {"interface": "slcan", "channel": self.adapter.port_name, "sleep_after_open": 0.0}
        self.grasps = [
            drivers.load_grasp(
                DriverSettings(driver="grasp_odrive_can", device="grasp_odrive", settings={"bus": bus, "node": k + 1}),
                replace(Place(name, Mount()), clock=Turning(self, k)),
            )
            for k, name in enumerate(("left", "right"))
        ]
        self.handles = np.zeros((2, 2))
        for grasp in self.grasps:
            grasp.found_timeout_s = 300.0
            grasp.open()

    def carry(self) -> None:
        """Let a millisecond pass on the wires, and the adapter carry to and fro."""
        for node in self.nodes:
            node.advance()
        while message := self.wires.recv(0.0):
            self.adapter.send(message)
        while message := self.adapter.recv(0.0):
            self.wires.send(message)

    def run(self, ticks: int, *torques_nm: float) -> None:
        for _ in range(ticks):
            self.carry()
            for grasp, handle, torque_nm in zip(self.grasps, self.handles, torques_nm, strict=True):
                grasp.read(0, handle)
                grasp.write(torque_nm)
            self.adapter.hear()

    def close(self) -> None:
        for each in (*self.grasps, *self.nodes):
            each.close()
        self.wires.shutdown()
        self.adapter.shutdown()


class Turning:
    """The time of a drive on the wires: both go on while a driver waits."""

    def __init__(self, bench: TwoOnSlcan, which: int) -> None:
        self._bench, self._which = bench, which

    def monotonic_ns(self) -> int:
        return self._bench.nodes[self._which].clock.monotonic_ns()

    def sleep(self, seconds: float) -> None:
        for _ in range(max(1, round(1e3 * seconds))):
            self._bench.carry()
            self._bench.adapter.hear(0.0)


@pytest.fixture
def two_on_slcan(tmp_path: Any) -> Iterator[TwoOnSlcan]:
    bench = TwoOnSlcan(str(tmp_path))
    yield bench
    bench.close()


def test_two_handles_share_one_adapter(two_on_slcan: TwoOnSlcan) -> None:
    """Each hears its own drive, whoever reads the line, and its torque reaches that drive alone."""
    left, right = two_on_slcan.nodes
    right.wanted_rad = 0.8
    two_on_slcan.run(200, 0.0, 0.0)
    angles = [node.drive.handle.angle_rad for node in two_on_slcan.nodes]
    np.testing.assert_allclose(two_on_slcan.handles[:, servo_arrays.HANDLE_ANGLE], angles, atol=2e-3)
    assert angles[1] > angles[0] + 0.1
    for grasp in two_on_slcan.grasps:
        grasp.enable()
    two_on_slcan.run(300, TORQUE_NM, -0.5 * TORQUE_NM)
    assert [node.drive.applied_nm for node in (left, right)] == pytest.approx([TORQUE_NM, -0.5 * TORQUE_NM])
    assert all(grasp.ready for grasp in two_on_slcan.grasps)
    two_on_slcan.grasps[0].close()
    for _ in range(50):
        two_on_slcan.carry()
        two_on_slcan.grasps[1].read(0, two_on_slcan.handles[1])
        two_on_slcan.grasps[1].write(-0.5 * TORQUE_NM)
        two_on_slcan.adapter.hear()
    assert right.drive.applied_nm == pytest.approx(-0.5 * TORQUE_NM), "one handle that is let go leaves the other"
    assert left.drive.applied_nm == 0.0


def test_an_adapter_has_one_bit_rate() -> None:
    adapter = Adapter()
    bus = {"interface": "slcan", "channel": adapter.port_name, "sleep_after_open": 0.0, "bitrate": 1_000_000}
    one = canbus.open_bus(bus, "instrument 'left'")
    with pytest.raises(DeviceError, match=r"instrument 'right': CAN bus slcan .*: it is in use with other settings"):
        canbus.open_bus(bus | {"bitrate": 500_000}, "instrument 'right'")
    one.shutdown()
    canbus.open_bus(bus | {"bitrate": 500_000}, "instrument 'right'").shutdown()
    adapter.shutdown()


def test_a_serial_port_that_is_not_there_is_one_sentence() -> None:
    with pytest.raises(DeviceError, match="CAN bus slcan /dev/nosuch cannot be opened") as caught:
        canbus.open_bus({"interface": "slcan", "channel": "/dev/nosuch"}, "instrument 'left'")
    assert "\n" not in str(caught.value)


def test_a_drive_on_udp_multicast_is_measured_and_loaded(monkeypatch: pytest.MonkeyPatch) -> None:
    """Frames are given back to who sent them there; when they come is the kernel's affair, so a drive may let go."""
    bus = {"interface": "udp_multicast", "channel": "239.74.163.2", "hop_limit": 0, "fd": False, "port": free_port()}
    _need_multicast(bus)
    monkeypatch.setenv(canbus.OPEN_BUS, "1")
    node = VirtualNode(can.Bus(**bus))
    grasp, handle = load(bus, node), np.zeros(2)
    grasp.found_timeout_s = 300.0
    grasp.open()
    for tick in range(20 * 300):
        if tick % 300 == 0:
            grasp.enable()
        node.advance()
        time.sleep(5e-4)
        grasp.read(0, handle)
        grasp.write(TORQUE_NM)
        holds = grasp.ready and node.drive.state is AxisState.CLOSED_LOOP
        if holds and handle[servo_arrays.HANDLE_ANGLE] == pytest.approx(0.55, abs=0.005):
            break
    else:
        pytest.fail("the torque never moved the handle")
    grasp.close()
    node.close()


def _need_multicast(bus: dict[str, Any]) -> None:
    try:
        with can.Bus(**bus) as one, can.Bus(**bus) as other:
            one.send(can.Message(arbitration_id=1, is_extended_id=False))
            heard = other.recv(5.0)
    except (can.CanError, OSError) as error:
        pytest.skip(f"this host has no multicast: {error}")
    if heard is None:
        pytest.skip("this host sends multicast to nobody")


@pytest.mark.parametrize(
    ("n_bytes", "is_extended", "bits"),
    [(0, False, 55), (4, False, 95), (8, False, 135), (4, True, 120), (8, True, 160)],
)
def test_a_frame_takes_as_many_bits_as_the_standard_says_at_worst(n_bytes: int, is_extended: bool, bits: int) -> None:
    assert frame_bits(n_bytes, is_extended=is_extended) == bits


def test_two_drives_at_1_khz_take_46_percent_of_a_bus_of_1_mbit() -> None:
    clock = SteppedClock()
    load = BusLoad(1e6, clock)
    for tick in range(1000):
        clock.sleep(1e-3)
        for _ in range(2):
            load.count(4)
            load.count(8)
            if tick % 100 == 0:
                load.count(8)
    assert load.share() == pytest.approx(0.463, abs=0.001)


def test_a_handle_tells_how_busy_its_bus_is_with_the_frames_of_others(tmp_path: Any) -> None:
    node, other = VirtualNode(str(tmp_path)), VirtualNode(str(tmp_path), node=2)
    grasp, handle = load({"interface": "virtual", "channel": str(tmp_path), "bitrate": 500_000}, node), np.zeros(2)
    grasp.open()
    grasp.gauges()
    for _ in range(600):
        node.advance()
        other.advance()
        grasp.read(0, handle)
        grasp.write(0.0)
    bits_s = 1e3 * (frame_bits(4) + 2 * frame_bits(8)) + 2 * 10 * frame_bits(8)
    assert grasp.gauges()["bus_load"] == pytest.approx(bits_s / 500_000, rel=0.02)
    grasp.close()
    node.close()
    other.close()
