"""Checks of a handle's CAN bus on this host: reachability, settings, and drives that answer; with advice."""

from __future__ import annotations

import contextlib
import importlib.util
import json
import os
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import can

from trocar.services.gateway.can import canbus, cansimple
from trocar.services.gateway.can.odrive_link import OdriveLink
from trocar.services.gateway.devices.clock import REAL_TIME
from trocar.services.gateway.devices.host_check import HostCheck, text_of
from trocar.services.runtime.errors import DeviceError

#: Drives send a heartbeat ten times a second.
_LISTEN_S = 0.5
_WHOLE = 8  # bytes of a heartbeat: a request for one has none
_UP = 1  # Linux: IFF_UP of <net/if.h>
_ARPHRD_CAN = "280"
_MAKE_VIRTUAL = "sudo modprobe vcan; sudo ip link add dev NAME type vcan; sudo ip link set NAME up"
#: Longer queues in the kernel would send outdated torques.
_LONGEST_QUEUE = 32
_SILENT = "look at the drive's power, node number, bit rate and heartbeat, at the wires and both terminations"
_FIRMWARE = "bring the drive to firmware 0.6 with ODrive's own tool; it then answers Get_Version (command 0x00)"
_MODULES = (
    "sudo modprobe can_raw (and `vcan` for a bus without wires); a kernel that was built without CAN, as some virtual "
    "machines have, takes an adapter on a serial line: interface slcan (docs/how-to/hardware.md)"
)


def check(handles: Sequence[tuple[dict[str, Any], int]], in_use: bool, root: Path = Path("/")) -> Iterator[HostCheck]:
    """Yield checks to make before handles, each (settings of a bus, node), are opened.

    Args:
        in_use: Whether a rig runs; no bus is opened then.
        root: Root of the file system with ``/sys``.
    """
    for k, (bus, _node) in enumerate(handles):
        if any(bus == earlier for earlier, _ in handles[:k]):
            continue
        found = list(_reach(bus, root))
        yield from found
        if not in_use and all(each.ok or not each.needed for each in found):
            yield from _listen(bus, [node for each, node in handles if each == bus])


def _reach(bus: dict[str, Any], root: Path) -> Iterator[HostCheck]:
    if bus.get("interface") == "socketcan":
        yield from _socketcan(bus, root)
    elif bus.get("interface") == "slcan":
        yield from _serial(bus, root)
    elif bus.get("interface") == "udp_multicast":
        said = f"everybody on the network can move the handle: {canbus.OPEN_BUS} is set"
        yield HostCheck(f"CAN {bus.get('channel')}", False, said, "for a hand use socketcan or slcan", needed=False)


def _socketcan(bus: dict[str, Any], root: Path) -> Iterator[HostCheck]:
    name = f"CAN {bus.get('channel')}"
    why = _kernel_refuses()
    if why:
        yield HostCheck(name, False, f"this kernel has no CAN: {why}", _MODULES, needed=True)
        return
    yield _interface(name, str(bus.get("channel")), canbus.bitrate(bus), root)


def _kernel_refuses() -> str:
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except OSError as error:
        return str(error.strerror or error).lower()
    return ""


def _interface(name: str, channel: str, bitrate: float, root: Path) -> HostCheck:
    place = root / "sys/class/net" / channel
    interfaces = sorted(each.name for each in place.parent.glob("*") if text_of(each / "type") == _ARPHRD_CAN)
    if channel not in interfaces:
        shown = f"no CAN interface {channel!r}; this host has {', '.join(interfaces) or 'none'}"
        advice = f"plug the adapter in; without wires: {_MAKE_VIRTUAL.replace('NAME', channel)}"
        return HostCheck(name, False, shown, advice, needed=True)
    if not int(text_of(place / "flags"), 16) & _UP:
        advice = f"{_set(channel, bitrate)}; sudo ip link set {channel} up (a bus without wires: the last of these)"
        return HostCheck(name, False, "down", advice, needed=True)
    wrong = _wrongly_set(channel, bitrate, int(text_of(place / "tx_queue_len") or 0))
    advice = f"sudo ip link set {channel} down; {_set(channel, bitrate)}; sudo ip link set {channel} up"
    return HostCheck(name, not wrong, wrong or "up", advice)


def _set(channel: str, bitrate: float) -> str:
    settings = f"type can bitrate {bitrate:.0f} restart-ms 100"
    return f"sudo ip link set {channel} {settings}; sudo ip link set {channel} txqueuelen 16"


def _wrongly_set(channel: str, bitrate: float, queue: int) -> str:
    """Return what is wrong with the settings of a physical bus; a virtual bus has none of these settings."""
    data = _told_by_ip(channel)
    wrong = []
    if "state" in data and data["state"] not in ("ERROR-ACTIVE", "ERROR-WARNING"):
        wrong.append(str(data["state"]).lower())
    real = data.get("bittiming", {}).get("bitrate", bitrate)
    if real != bitrate:
        wrong.append(f"at {real} bit/s, the rig file says {bitrate:.0f}")
    if "state" in data and not data.get("restart_ms"):
        wrong.append("stays away after a bus-off (restart-ms 0)")
    if queue > _LONGEST_QUEUE:
        wrong.append(f"{queue} frames may wait in the kernel")
    return "; ".join(wrong)


def _told_by_ip(channel: str) -> dict[str, Any]:
    program = shutil.which("ip")
    if program is None:
        return {}
    command = [program, "-json", "-details", "link", "show", "dev", channel]
    told = subprocess.run(command, capture_output=True, text=True, check=False)
    try:
        found: dict[str, Any] = json.loads(told.stdout)[0]["linkinfo"]["info_data"]
    except (ValueError, LookupError):
        return {}
    return found


def _serial(bus: dict[str, Any], root: Path) -> Iterator[HostCheck]:
    port = Path(str(bus.get("channel")))
    name = f"CAN adapter {port}"
    if importlib.util.find_spec("serial") is None:
        yield HostCheck(name, False, "pyserial is missing", "pip install pyserial", needed=True)
    place = root / port.relative_to("/") if port.is_absolute() else port
    if not place.exists():
        folder = root / "dev/serial/by-id"
        others = [f"/dev/serial/by-id/{each.name}" for each in sorted(folder.glob("*"))]
        shown = f"no such port; serial ports: {', '.join(others) or 'none'}"
        yield HostCheck(name, False, shown, "plug the adapter in, or name its port as `channel`", needed=True)
    elif not os.access(place, os.R_OK | os.W_OK):
        advice = "sudo adduser $USER dialout, and a new login"
        yield HostCheck(name, False, "not yours to open", advice, needed=True)
    else:
        yield HostCheck(name, True, "there", "")


def _listen(bus: dict[str, Any], nodes: list[int]) -> Iterator[HostCheck]:
    """Open the bus, ask the drives for their firmware, and report those that are heard."""
    where = " ".join(str(bus[key]) for key in ("interface", "channel") if key in bus)
    try:
        opened = canbus.open_bus(bus, "here")
    except DeviceError as error:
        said = str(error).removeprefix("here: ")
        yield HostCheck(f"CAN bus {where}", False, said, "docs/how-to/hardware.md has a table of adapters", needed=True)
        return
    try:
        heard = _Heard(opened, nodes)
        heard.listen(_LISTEN_S)
        noise = canbus.noise(opened)
    finally:
        opened.shutdown()
    for node in dict.fromkeys(nodes):
        if nodes.count(node) > 1:
            yield HostCheck(f"drive {node} on {where}", False, "two handles have this node", "give each its own node")
        else:
            yield heard.judge(node, f"drive {node} on {where}", noise)


class _Heard:
    """What the nodes of a bus say.

    Only the rig's own nodes are asked for their firmware, which are idle as no rig runs.
    """

    def __init__(self, bus: can.BusABC, nodes: Sequence[int]) -> None:
        self._bus = bus
        self._links = {node: OdriveLink(bus, node, REAL_TIME, _LISTEN_S, canbus.DEFAULT_BITRATE) for node in nodes}
        self._frames, self._beating = 0, set[int]()

    def listen(self, seconds: float) -> None:
        """Listen, and ask each node for its version until it has told it."""
        until_s = time.monotonic() + seconds
        while time.monotonic() < until_s:
            for link in self._links.values():
                with contextlib.suppress(can.CanError):  # a bus that cannot send is told of by its silence
                    link.ask_version()
            for message in canbus.drain(self._bus):
                self._take_message(message)
            time.sleep(0.01)

    def _take_message(self, message: can.Message) -> None:
        self._frames += 1
        is_heartbeat = cansimple.command(message.arbitration_id) == cansimple.HEARTBEAT and len(message.data) == _WHOLE
        if is_heartbeat and not message.is_extended_id:
            self._beating.add(message.arbitration_id >> 5)
        for link in self._links.values():
            link.take_message(message)

    def judge(self, node: int, name: str, noise: str) -> HostCheck:
        """Return what was heard of a node."""
        link = self._links[node]
        if link.state is None:
            return HostCheck(name, False, self._silence(noise), _SILENT)
        firmware, said = link.firmware, f"axis state {link.state}, {cansimple.error_names(link.errors) or 'no error'}"
        if firmware.is_wrong:
            return HostCheck(name, False, firmware.problem, _FIRMWARE, needed=True)
        if firmware.problem:
            return HostCheck(name, False, f"{said}; it {firmware.problem}", _FIRMWARE)
        return HostCheck(name, True, said, "")

    def _silence(self, noise: str) -> str:
        others = ", ".join(map(str, sorted(self._beating - self._links.keys()))) or "none"
        said = f"no heartbeat within {_LISTEN_S:g} s; other nodes heard: {others}"
        if noise:
            return f"{said}; {noise}"
        return (
            f"{said}; {self._frames} frames came, none is a heartbeat" if self._frames and not self._beating else said
        )
