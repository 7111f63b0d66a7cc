"""Frames to and from one ODrive on a CAN bus."""

from __future__ import annotations

import math
import struct

import can

from trocar.services.gateway.can import canbus, cansimple
from trocar.services.gateway.can.bus_load import BusLoad
from trocar.services.gateway.can.odrive_firmware import FirmwareCheck
from trocar.services.gateway.devices.clock import Clock

_TORQUE_BYTES = struct.calcsize("<f")
_ASK_EVERY_NS = round(1e9 * cansimple.HEARTBEAT_S)


class OdriveLink:
    """Frames to and from one node.

    Args:
        patience_s: A backlog of a longer pause is discarded: its age is unknown, since a full queue keeps the oldest
            frames.

    Attributes:
        angle_turns, rate_turns_s: float. Newest encoder estimates.
        errors, state: int. Those of the newest heartbeat; None before the first.
        estimated_ns, heartbeat_ns: int. Times of their arrival, by this host's monotonic clock.
        firmware: FirmwareCheck. What its frames tell of its firmware.
    """

    def __init__(self, bus: can.BusABC, node: int, clock: Clock, patience_s: float, bitrate: float) -> None:
        self.bus = bus
        self.load = BusLoad(bitrate, clock)
        self._clock = clock
        self._patience_ns = round(patience_s * 1e9)
        self._listened_ns = 0
        self.angle_turns = self.rate_turns_s = 0.0
        self.errors = 0
        self.state: int | None = None
        self.estimated_ns = self.heartbeat_ns = 0
        self.firmware = FirmwareCheck()
        self._asked_ns = -_ASK_EVERY_NS
        self._version_id = cansimple.identifier(node, cansimple.GET_VERSION)
        self._heartbeat_id = cansimple.identifier(node, cansimple.HEARTBEAT)
        self._estimates_id = cansimple.identifier(node, cansimple.GET_ENCODER_ESTIMATES)
        self._base = cansimple.identifier(node, 0)
        self._torque_id = self._base | cansimple.SET_INPUT_TORQUE
        self._torque = can.Message(arbitration_id=self._torque_id, is_extended_id=False, dlc=_TORQUE_BYTES)

    def receive(self) -> None:
        """Read received frames."""
        now_ns = self._clock.monotonic_ns()
        piled_up = now_ns - self._listened_ns > self._patience_ns
        count = 0
        for message in canbus.drain(self.bus):
            count += 1
            self.take_message(message, is_old=piled_up)
        if count < canbus.DRAIN_LIMIT:  # otherwise there is more of the backlog
            self._listened_ns = now_ns

    def take_message(self, message: can.Message, *, is_old: bool = False) -> None:
        """Take a frame of the bus. Some interfaces echo own frames, whose identifiers are not those of the drive.

        Args:
            message: Of any node.
            is_old: Whether it may be older than `patience_s`.
        """
        identifier = message.arbitration_id
        if identifier != self._torque_id:
            self.load.count(message.dlc, is_extended=message.is_extended_id)
        if message.is_remote_frame or message.is_extended_id:
            return
        try:
            if identifier == self._estimates_id:
                if not is_old:
                    self._take_estimates(bytes(message.data))
            elif identifier == self._heartbeat_id:
                self.errors, self.state = cansimple.unpack_heartbeat(bytes(message.data))
                self.firmware.take_heartbeat(bytes(message.data))
                self.heartbeat_ns = self._clock.monotonic_ns()
            elif identifier == self._version_id:
                self.firmware.take_version(bytes(message.data))
        except struct.error:
            return  # a wrong length: not from a drive

    def send(self, command: int, data: bytes = b"") -> None:
        """Send a command."""
        self.load.count(len(data))
        self.bus.send(can.Message(arbitration_id=self._base | command, data=data, is_extended_id=False))

    def ask_version(self) -> None:
        """Ask for the firmware's version, at most ten times a second, until it is told.

        Only an idle drive is to be asked, as any frame to it feeds its watchdog.
        """
        now_ns = self._clock.monotonic_ns()
        if self.firmware.version is not None or now_ns - self._asked_ns < _ASK_EVERY_NS:
            return
        self._asked_ns = now_ns
        self.load.count(0)
        self.bus.send(can.Message(arbitration_id=self._version_id, is_remote_frame=True, is_extended_id=False))

    def send_torque(self, torque_nm: float) -> None:
        """Send a motor torque; the message is reused, as this is called every tick."""
        self.load.count(_TORQUE_BYTES)
        self._torque.data = bytearray(cansimple.pack_float(torque_nm))
        self.bus.send(self._torque)

    def _take_estimates(self, data: bytes) -> None:
        angle, rate = cansimple.unpack_floats(data)
        if math.isfinite(angle + rate):
            self.angle_turns, self.rate_turns_s = angle, rate
            self.estimated_ns = self._clock.monotonic_ns()
