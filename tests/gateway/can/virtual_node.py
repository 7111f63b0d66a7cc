"""An emulated drive on a bus of python-can, and the only time that it and its driver know: exact and quick."""

from __future__ import annotations

import can

from tests.gateway.devices.bench import TICK_S, SteppedClock
from trocar.services.gateway.can import canbus, cansimple
from trocar.services.gateway.simulated.emulated_drive import CanFrame, EmulatedDrive, Handle

_WATCHDOG_S = 0.05


class VirtualNode:
    """A node whose handle stays where it is unless it is told otherwise.

    Parameters
    ----------
    bus
        What the drive is on, given up with it; a name is that of a channel of the in-process bus.
    node
        Its number on the bus.
    handle
        What hangs on the motor.

    Attributes
    ----------
    hearing, speaking
        Whether frames of the bus reach it, and its own the bus.
    unsaid
        Commands of which it says nothing all the same.
    wanted_rad
        Where the hand on the handle wants it.
    """

    def __init__(self, bus: str | can.BusABC, node: int = 1, handle: Handle | None = None) -> None:
        self.drive = EmulatedDrive(node, _WATCHDOG_S, handle or Handle(0.5))
        self.clock = SteppedClock(self._tick)
        self.hearing = self.speaking = True
        self.unsaid: set[int] = set()
        self.wanted_rad = self.drive.handle.angle_rad
        self._bus = can.Bus(interface="virtual", channel=bus) if isinstance(bus, str) else bus

    def advance(self, seconds: float = TICK_S) -> None:
        """Let time pass."""
        self.clock.sleep(seconds)

    def power_up(self, bus: can.BusABC) -> None:
        """Be switched on anew, on another bus: what it was told is forgotten, its handle is where it was."""
        self._bus, self.drive = bus, EmulatedDrive(self.drive.node, _WATCHDOG_S, self.drive.handle)

    def close(self) -> None:
        """Leave the bus."""
        self._bus.shutdown()

    def _tick(self, now_s: float) -> None:
        for message in canbus.drain(self._bus):
            if self.hearing:
                data = bytes(message.data)
                self._say(self.drive.receive(message.arbitration_id, data, message.is_remote_frame, now_s))
        self._say(self.drive.step(self.wanted_rad, now_s, TICK_S))

    def _say(self, frames: list[CanFrame]) -> None:
        for identifier, data in frames:
            if self.speaking and cansimple.command(identifier) not in self.unsaid:
                self._bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))
