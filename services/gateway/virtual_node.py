"""An emulated drive on python-can's in-process bus, and the only time that it and its driver know: exact and quick."""

from __future__ import annotations

import can

from services.gateway import canbus
from services.gateway.bench import TICK_S, SteppedClock
from services.gateway.emulated_drive import EmulatedDrive, Handle

_WATCHDOG_S = 0.05


class VirtualNode:
    """A node whose handle wants to stay where it is.

    Parameters
    ----------
    channel
        Of the in-process bus.
    node
        Its number on the bus.
    angle_rad
        Of the handle.

    Attributes
    ----------
    speaking
        Whether its frames reach the bus.
    """

    def __init__(self, channel: str, node: int = 1, angle_rad: float = 0.5) -> None:
        self.drive = EmulatedDrive(node, _WATCHDOG_S, Handle(angle_rad))
        self.clock = SteppedClock(self._tick)
        self.speaking = True
        self._angle_rad = angle_rad
        self._bus = can.Bus(interface="virtual", channel=channel)

    def advance(self, seconds: float = TICK_S) -> None:
        """Let time pass."""
        self.clock.sleep(seconds)

    def close(self) -> None:
        """Leave the bus."""
        self._bus.shutdown()

    def _tick(self, now_s: float) -> None:
        for message in canbus.drain(self._bus):
            self.drive.receive(message.arbitration_id, bytes(message.data), message.is_remote_frame, now_s)
        frames = self.drive.step(self._angle_rad, now_s, TICK_S)
        if self.speaking:
            for identifier, data in frames:
                self._bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))
