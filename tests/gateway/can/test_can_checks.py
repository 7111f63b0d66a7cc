"""What `trocar doctor` says of CAN buses and the drives on them, on hosts made up of files and on a pseudo terminal."""

from __future__ import annotations

import json
import os
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from threading import Event, Thread
from typing import Any

import can
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.gateway.can.drives_to_try import LiveAdapter
from tests.gateway.can.slcan_adapter import Adapter
from tests.gateway.can.virtual_node import VirtualNode
from tests.patience import PATIENCE_S
from trocar.services.gateway.can import can_checks, canbus
from trocar.services.gateway.can.odrive_firmware import FirmwareCheck
from trocar.services.gateway.devices.host_check import HostCheck
from trocar.services.gateway.drivers import check_host
from trocar.services.runtime.config.rig import DriverSettings

SOCKET: dict[str, Any] = {"interface": "socketcan", "channel": "can0"}
#: For so many heartbeats that a machine which stands still meanwhile leaves some.
LISTEN_S = 3.0
GOOD = {"state": "ERROR-ACTIVE", "restart_ms": 100, "bittiming": {"bitrate": 1_000_000}}


@pytest.fixture(autouse=True)
def _kernel_with_can(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(can_checks, "_kernel_refuses", lambda: "")
    monkeypatch.setattr(can_checks, "_told_by_ip", lambda _channel: {})


def interface(root: Path, name: str, flags: str = "0x40081", queue: int = 16, kind: int = 280) -> None:
    folder = root / "sys/class/net" / name
    folder.mkdir(parents=True)
    for file, text in (("flags", flags), ("tx_queue_len", str(queue)), ("type", str(kind))):
        (folder / file).write_text(f"{text}\n")


def look(root: Path, bus: dict[str, Any], in_use: bool = True) -> HostCheck:
    return next(can_checks.check([(bus, 1)], in_use, root))


def test_a_kernel_without_can_is_told_what_to_take_instead(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(can_checks, "_kernel_refuses", lambda: "address family not supported by protocol")
    found = look(tmp_path, SOCKET)
    assert (found.ok, found.needed) == (False, True)
    assert "modprobe can_raw" in found.advice
    assert "slcan" in found.advice


def test_a_bus_that_everybody_can_send_to_is_told(tmp_path: Path) -> None:
    found = look(tmp_path, {"interface": "udp_multicast", "channel": "239.0.0.1"})
    assert not found.ok
    assert "everybody on the network can move the handle" in found.found


def test_an_interface_that_is_not_there_is_told_with_those_that_are(tmp_path: Path) -> None:
    interface(tmp_path, "eth0", kind=1)
    interface(tmp_path, "can1")
    found = look(tmp_path, SOCKET)
    assert found.found == "no CAN interface 'can0'; this host has can1"
    assert "sudo ip link add dev can0 type vcan" in found.advice
    assert not look(tmp_path, {**SOCKET, "channel": "eth0"}).ok


def test_an_interface_that_is_down_is_told_how_to_set_it_up_at_the_rig_files_speed(tmp_path: Path) -> None:
    interface(tmp_path, "can0", flags="0x40080")
    found = look(tmp_path, {**SOCKET, "bitrate": 500_000})
    assert (found.ok, found.found) == (False, "down")
    assert "sudo ip link set can0 type can bitrate 500000 restart-ms 100" in found.advice


@pytest.mark.parametrize(
    ("changed", "queue", "said"),
    [
        ({}, 16, ""),
        ({"state": "BUS-OFF"}, 16, "bus-off"),
        ({"bittiming": {"bitrate": 250_000}}, 16, "at 250000 bit/s, the rig file says 1000000"),
        ({"restart_ms": 0}, 16, "stays away after a bus-off (restart-ms 0)"),
        ({}, 1000, "1000 frames may wait in the kernel"),
    ],
)
def test_what_is_set_wrongly_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, changed: dict[str, Any], queue: int, said: str
) -> None:
    monkeypatch.setattr(can_checks, "_told_by_ip", lambda _channel: GOOD | changed)
    interface(tmp_path, "can0", queue=queue)
    found = look(tmp_path, SOCKET)
    assert (found.ok, found.found, found.needed) == (not said, said or "up", False)


def test_a_bus_without_wires_needs_no_settings(tmp_path: Path) -> None:
    interface(tmp_path, "vcan0", flags="0xc1", queue=0)
    assert look(tmp_path, {**SOCKET, "channel": "vcan0"}).ok


def test_what_ip_says_is_understood(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()
    program = tmp_path / "ip"
    link = [{"ifname": "can0", "flags": ["UP"], "linkinfo": {"info_kind": "can", "info_data": GOOD}}]
    program.write_text(f"#!/bin/sh\n[ \"$*\" = '-json -details link show dev can0' ] && echo '{json.dumps(link)}'\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert can_checks._told_by_ip("can0") == GOOD
    assert can_checks._told_by_ip("can1") == {}


def test_a_serial_port_that_is_not_there_or_closed_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bus = {"interface": "slcan", "channel": "/dev/ttyACM0"}
    named = tmp_path / "dev/serial/by-id/usb-CANable"
    named.parent.mkdir(parents=True)
    named.touch()
    assert look(tmp_path, bus).found == "no such port; serial ports: /dev/serial/by-id/usb-CANable"
    (tmp_path / "dev/ttyACM0").touch()
    assert look(tmp_path, bus).ok
    monkeypatch.setattr(os, "access", lambda _path, _mode: False)
    assert "dialout" in look(tmp_path, bus).advice


def test_drives_are_listened_for_on_each_bus_once_unless_the_rig_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(can_checks, "_LISTEN_S", LISTEN_S)
    bus = {"interface": "virtual", "channel": str(tmp_path)}
    assert list(can_checks.check([(bus, 1)], in_use=True)) == []
    node = Speaking(str(tmp_path), node=3)
    try:
        missing, there = can_checks.check([(bus, 1), (bus, 3)], in_use=False)
    finally:
        node.end()
    assert (missing.ok, missing.found) == (False, f"no heartbeat within {LISTEN_S:g} s; other nodes heard: none")
    assert (there.ok, there.found) == (True, "axis state 1, no error")


class Speaking:
    """An emulated drive that lives by the real time, in a thread."""

    def __init__(self, channel: str, node: int) -> None:
        from threading import Thread

        self._node, self._ends = VirtualNode(channel, node), False
        self._thread = Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        """Live through as much time as has passed, however seldom the machine lets it."""
        began_s, lived_s = time.monotonic(), 0.0
        while not self._ends:
            while lived_s < time.monotonic() - began_s:
                self._node.advance()
                lived_s += 1e-3
            time.sleep(1e-3)

    def end(self) -> None:
        self._ends = True
        self._thread.join()
        self._node.close()


@pytest.fixture
def serial_port(tmp_path: Path) -> Iterator[Path]:
    """The port of drives that live in a process of their own, as docs/how-to/hardware.md has them."""
    port = tmp_path / "adapter"
    drives = subprocess.Popen([sys.executable, "-m", "tests.gateway.can.drives_to_try", str(port)])
    until_s = time.monotonic() + PATIENCE_S
    while not port.exists() and drives.poll() is None and time.monotonic() < until_s:
        time.sleep(0.02)
    yield port
    drives.kill()
    drives.wait()


def test_the_drives_to_try_are_heard_through_their_adapter(serial_port: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(can_checks, "_LISTEN_S", LISTEN_S)
    bus = {"interface": "slcan", "channel": str(serial_port), "bitrate": 1_000_000, "sleep_after_open": 0.0}
    named = [
        DriverSettings(driver="grasp_odrive_can", device="grasp_odrive", settings={"bus": bus, "node": node})
        for node in (1, 2)
    ]
    adapter, *drives = check_host(named, in_use=False)
    assert adapter.ok
    assert [drive.found for drive in drives] == ["axis state 1, no error"] * 2


@pytest.mark.parametrize(
    ("version", "heartbeat", "said"),
    [
        ((0, 6), (0, 1, 0, 0, 0), ""),
        ((0, 6), (0x4000, 1, 3, 1, 0), ""),
        ((0, 5), (0, 1, 0, 0, 0), "speaks firmware 0.5, 0.6 is needed"),
        ((0, 4), (0, 1, 0, 0, 0), "speaks firmware 0.4, 0.6 is needed"),
        ((0, 7), (0, 1, 0, 0, 0), "speaks firmware 0.7, 0.6 is needed"),
        (None, (0x4000, 1, 0, 0, 0), "speaks firmware 0.5, 0.6 is needed"),
        (None, (0x100, 1, 0, 0, 0), "speaks firmware 0.5, 0.6 is needed"),
        (None, (0, 1, 1, 1, 1), "speaks firmware 0.5, 0.6 is needed"),
        ((0, 6), (0, 1, 0, 0, 1), "speaks firmware 0.5, 0.6 is needed"),
        (None, (0, 8, 0, 0, 0x80), "speaks firmware 0.5, 0.6 is needed"),
    ],
)
def test_firmware_is_told_by_version_and_heartbeat(
    version: tuple[int, int] | None, heartbeat: tuple[int, int, int, int, int], said: str
) -> None:
    check = FirmwareCheck()
    if version is not None:
        check.take_version(bytes((2, 3, 6, 0, *version, 4, 0)))
    check.take_heartbeat(struct.pack("<IBBBB", *heartbeat))
    assert (check.problem if check.is_wrong else "") == said
    assert check.is_needed == (version == (0, 6) and not said)


@given(
    errors=st.integers(0, 2**32 - 1), state=st.integers(0, 255), flags=st.tuples(*3 * [st.integers(0, 255)]),
    version=st.one_of(st.none(), st.tuples(st.integers(0, 255), st.integers(0, 255))),
)  # fmt: skip
def test_no_drive_is_used_that_has_not_told_0_6_and_none_is_refused_that_is_as_0_6_is(
    errors: int, state: int, flags: tuple[int, int, int], version: tuple[int, int] | None
) -> None:
    check = FirmwareCheck()
    if version is not None:
        check.take_version(bytes((2, 5, 2, 0, *version, 11, 0)))
    check.take_heartbeat(struct.pack("<IBBBB", errors, state, *flags))
    assert not check.is_needed or version == (0, 6)
    if version == (0, 6) and flags[1] < 2 and flags[2] == 0 and not errors & 0xE0080:
        assert check.is_needed
    if version not in (None, (0, 6)):
        assert check.problem == f"speaks firmware {version[0]}.{version[1]}, 0.6 is needed"
    assert not (check.is_needed and check.is_wrong)


@given(
    said=st.lists(st.sampled_from(("frame", "noise", "z", "Z", "")), max_size=12),
    end=st.sampled_from((b"\r", b"\r\n", b"\n", b"\n\r")),
    blank=st.sampled_from((b"", b" ", b"\t")),
    cut=st.integers(1, 40),
)
@settings(max_examples=150, deadline=None)
def test_lines_are_read_with_any_end_and_noise_is_told_from_silence(
    said: list[str], end: bytes, blank: bytes, cut: int
) -> None:
    lines = {"frame": b"t02180000000001000000", "noise": b"# hello", "z": b"z", "Z": b"Z", "": b""}
    adapter = Adapter()
    bus = canbus.open_bus(
        {"interface": "slcan", "channel": adapter.port_name, "bitrate": 1_000_000, "sleep_after_open": 0.0}, "here"
    )
    try:
        text = b"".join(blank + lines[each] + end for each in said)
        heard = []
        for k in range(0, len(text), cut):
            adapter.say(text[k : k + cut])
            heard += list(canbus.drain(bus))
        assert [message.arbitration_id for message in heard] == [0x21] * said.count("frame")
        noisy = said.count("noise")
        assert canbus.noise(bus).startswith(f"{noisy} lines came that are no frames" if noisy else "")
        assert bool(canbus.noise(bus)) == bool(noisy)
    finally:
        bus.shutdown()
        adapter.shutdown()


def test_what_comes_and_is_no_frame_is_in_the_sentence_of_a_drive_that_is_not_heard() -> None:
    adapter = LiveAdapter()
    bus = {"interface": "slcan", "channel": adapter.port_name, "bitrate": 1_000_000, "sleep_after_open": 0.0}
    stop = Event()

    def speak() -> None:
        while not stop.wait(0.02):
            adapter.say(b"hello\r\n")

    speaker = Thread(target=speak)
    speaker.start()
    try:
        found = list(can_checks.check([(bus, 1)], in_use=False))[-1]
    finally:
        stop.set()
        speaker.join()
        adapter.shutdown()
    assert not found.ok
    assert "lines came that are no frames: look at the adapter's protocol (slcan) and baud rate" in found.found


def test_firmware_and_what_is_no_heartbeat_are_told_by_node(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(can_checks, "_LISTEN_S", LISTEN_S)
    bus = {"interface": "virtual", "channel": str(tmp_path)}
    stop = Event()

    def speak() -> None:
        with can.Bus(**bus) as drives:
            while not stop.wait(0.02):
                for node, end in ((1, 1), (2, 0), (9, 0)):  # the last byte: a flag of firmware 0.5
                    data = struct.pack("<IBBBB", 0, 1, 0, 0, end)
                    drives.send(can.Message(arbitration_id=node << 5 | 1, data=data, is_extended_id=False))
                drives.send(can.Message(arbitration_id=7 << 5 | 1, is_remote_frame=True, is_extended_id=False))

    speaker = Thread(target=speak)
    speaker.start()
    try:
        old, silent_on_it, missing = can_checks.check([(bus, 1), (bus, 2), (bus, 3)], in_use=False)
    finally:
        stop.set()
        speaker.join()
    assert (old.ok, old.needed, old.found) == (False, True, "speaks firmware 0.5, 0.6 is needed")
    assert silent_on_it.found == (
        "axis state 1, no error; it does not tell its firmware (Get_Version), as 0.5 does not: 0.6 is needed"
    )
    assert missing.found == f"no heartbeat within {LISTEN_S:g} s; other nodes heard: 9"


def test_two_handles_with_one_node_are_told(tmp_path: Path) -> None:
    bus = {"interface": "virtual", "channel": str(tmp_path)}
    (found,) = can_checks.check([(bus, 1), (bus, 1)], in_use=False)
    assert (found.ok, found.found) == (False, "two handles have this node")
