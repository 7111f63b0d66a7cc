"""The emulated drives of a gateway, all in one process: ``python -m trocar.services.gateway.simulated.drive_process``.

Its standard input is a socket for orders of the gateway; the process ends when it closes, as it does when the gateway
dies. Each drive has a bus of its own. The cost is small and bounded: a tick every 2 ms, in which each drive reads a few
frames and sends one, all of 16 bytes, through non-blocking sockets.
"""

from __future__ import annotations

import trocar.services.start.entry  # noqa: F401  first: the environment of a process
from trocar.services.gateway.simulated.hand_motion import MOTION_HZ

# isort: split
import array
import os
import socket
import struct
import sys
import time

from trocar.services.gateway.can import can_frame
from trocar.services.gateway.simulated import drive_orders
from trocar.services.gateway.simulated.drive_orders import Add, Ask, BeginAgain, GoOn, Order, SetPace
from trocar.services.gateway.simulated.emulated_drive import ESTIMATE_S, CanFrame, EmulatedDrive, Handle
from trocar.services.runtime.realtime import realtime

_PERIOD_NS = round(ESTIMATE_S * 1e9)
_LISTEN_EVERY = 5  # so that orders, for which a test or a scene's begin waits, are heard within 10 ms
#: Share of a core that a real-time budget has to cover: two drives take 2.0 % on average, three times that in a tick.
SHARE = 0.06
#: Bytes read in a tick. The gateway sends a frame every 2 ms, so that the backlog of a stall is read in a few ticks.
_READ = 64 * can_frame.SIZE


class DriveAxis:
    """One drive with its bus, and the hand on its handle."""

    def __init__(self, order: Add, bus: socket.socket, angle_rad: array.array[float]) -> None:
        self.drive = EmulatedDrive(order.node, order.watchdog_s, Handle(angle_rad[0]))
        self.goes_on = False
        self.pace = 1.0
        self._bus = bus
        bus.setblocking(False)
        self._angle_rad = angle_rad
        self._repeats = order.repeats
        self._began_s = self._last_s = 0.0

    def begin_again(self) -> None:
        """Reset the handle to its start, and restart the hand's motion."""
        self.goes_on = self.drive.armed_once = False
        self._began_s = 0.0
        self.drive.handle.angle_rad, self.drive.handle.rate_rad_s = self._angle_rad[0], 0.0

    def tick(self, now_s: float) -> None:
        """Receive frames, move the handle, send frames."""
        self._hear(now_s)
        self._began_s += (1.0 - self.pace) * (now_s - self._last_s) if self._began_s else 0.0
        self._last_s = now_s
        if not self._began_s and (self.goes_on or self.drive.armed_once):
            self._began_s = now_s
        self._say(self.drive.step(self._wanted_rad(now_s), now_s, ESTIMATE_S))

    def _wanted_rad(self, now_s: float) -> float:
        """Return the hand's target angle; its motion starts with the torque, or by order."""
        k = int((now_s - self._began_s) * MOTION_HZ) if self._began_s else 0
        n = len(self._angle_rad)
        return self._angle_rad[k % n if self._repeats else min(k, n - 1)]

    def _hear(self, now_s: float) -> None:
        try:
            frames = self._bus.recv(_READ)
        except OSError:  # no frame, or no reader
            return
        for identifier, data in can_frame.unpack(frames):
            if not identifier & can_frame.EXTENDED:
                remote = bool(identifier & can_frame.REMOTE)
                self._say(self.drive.receive(identifier & can_frame.ADDRESS, data, remote, now_s))

    def _say(self, frames: list[CanFrame]) -> None:
        for identifier, data in frames:
            try:
                self._bus.send(can_frame.pack(identifier, data))
            except OSError:  # no reader: a real bus does not store frames either
                return


class Drives:
    """All emulated drives of the process."""

    def __init__(self, gateway: socket.socket) -> None:
        self._gateway = gateway
        gateway.setblocking(False)
        self._axes: dict[int, DriveAxis] = {}

    def tick(self, now_s: float) -> None:
        """Advance every drive."""
        for axis in self._axes.values():
            axis.tick(now_s)

    def obey(self) -> bool:
        """Execute the gateway's orders; return False if it has gone."""
        while True:
            try:
                text, descriptors, _flags, _address = socket.recv_fds(
                    self._gateway, drive_orders.LONGEST, drive_orders.DESCRIPTORS
                )
            except BlockingIOError:
                return True
            except OSError:
                return False
            if not text:
                return False
            self._do(drive_orders.decode(text), descriptors)

    def _do(self, order: Order, descriptors: list[int]) -> None:
        match order:
            case Add():
                bus, motion = descriptors
                self._axes[order.node] = DriveAxis(order, socket.socket(fileno=bus), _read_angles(motion))
            case GoOn():
                self._axes[order.node].goes_on = True
            case BeginAgain():
                self._axes[order.node].begin_again()
            case SetPace():
                self._axes[order.node].pace = order.pace
            case Ask():
                self._gateway.send(struct.pack("=d", self._axes[order.node].drive.applied_nm))


def _read_angles(descriptor: int) -> array.array[float]:
    angles = array.array("d")
    with open(descriptor, "rb") as file:
        file.seek(0)
        angles.frombytes(file.read())
    return angles


def main(core: int | None, priority: int | None) -> None:
    """Run the drives until the gateway has gone."""
    _release_scheduling()
    _facts, scheduling = realtime.set_up(core, priority, share=SHARE)
    drives = Drives(socket.socket(fileno=sys.stdin.fileno()))
    realtime.keep_pages()
    realtime.freeze_garbage_collector()
    if scheduling is not None:
        scheduling.resume()
    due_ns, turn = time.monotonic_ns(), 0
    while turn % _LISTEN_EVERY or drives.obey():
        drives.tick(time.monotonic_ns() * 1e-9)
        turn += 1
        now_ns = time.monotonic_ns()
        due_ns += _PERIOD_NS * max(1, -((due_ns - now_ns) // _PERIOD_NS))  # skips missed ticks
        time.sleep(max(0, due_ns - now_ns) * 1e-9)


def _release_scheduling() -> None:
    """Reset the core and scheduling class inherited from the gateway."""
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    if os.getpriority(os.PRIO_PROCESS, 0) < 0:
        os.setpriority(os.PRIO_PROCESS, 0, 0)
    os.sched_setaffinity(0, range(os.cpu_count() or 1))


if __name__ == "__main__":
    main(*(None if word == "-" else int(word) for word in sys.argv[1:3]))
