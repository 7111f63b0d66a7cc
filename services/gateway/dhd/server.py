"""The thread of a device, which an arm and a gripper share: it exchanges when it is asked, and else lets go."""

from __future__ import annotations

import contextlib
import os
import threading
from collections import deque

from trocar.services.gateway.devices.asked_arm import ArmAnswer
from trocar.services.gateway.devices.clock import Clock
from trocar.services.gateway.devices.limited_force import NO_FORCE
from trocar.services.gateway.devices.vendor_library import RAISE_EVERY
from trocar.services.gateway.dhd.exchange import DhdDevice, DhdSample
from trocar.services.gateway.dhd.library import DhdLibrary
from trocar.services.runtime.config.rig import Vector3
from trocar.services.runtime.errors import DeviceError

#: An order is trusted for so long; a gateway that stands still gives the hand nothing.
STALE_NS = 20_000_000
_JOIN_S = 1.0  # a call under way takes about a millisecond; one that takes longer hangs


class DeviceServer:
    """Serves one open device in a thread of its own.

    Attributes:
        newest: DhdSample | None, and when it was taken.
        lost: str. Empty, or why the device is not served any more.
    """

    def __init__(self, library: DhdLibrary, serial: int | None, gravity: bool, where: str, clock: Clock) -> None:
        handle = library.open_device(serial, where)
        self.device = DhdDevice(library, handle)
        self.model = library.name(handle)
        self.newest: DhdSample | None = None
        self.newest_ns = 0
        self.lost = ""
        self.asked = self.answered = 0
        self.answers: deque[tuple[int, DhdSample]] = deque(maxlen=8)
        self._clock = clock
        self._order: tuple[int, Vector3] = (0, NO_FORCE)
        self._grip: tuple[int, float] = (0, 0.0)
        self._gripped_ns = 0  # when the order was given that the gripper has
        self._motors = self._ended = self._is_raised = False
        self._wake = threading.Event()
        if library.c.dhdSetGravityCompensation(int(gravity), handle) < 0:
            why = library.error()
            library.c.dhdClose(handle)
            raise DeviceError(f"{where}: the compensation of weight cannot be set: {why}")
        self._thread = threading.Thread(target=self._run, name=f"serves-{self.model}", daemon=True)
        self._thread.start()

    def ask_state(self, force_n: Vector3, now_ns: int) -> None:
        """Ask for an exchange with this force on the arm."""
        self._order = (now_ns, force_n)
        self.asked += 1
        if not self._is_raised and self.asked % RAISE_EVERY == 0:
            self._raise_priority()
        self._wake.set()

    def grip(self, force_n: float, now_ns: int) -> None:
        """Ask for an exchange with this force on the gripper."""
        self._grip = (now_ns, force_n)
        self._wake.set()

    @property
    def grip_outstanding(self) -> bool:
        """Whether the gripper's last order is not with the device yet."""
        return self._grip[0] != self._gripped_ns

    @property
    def is_limp(self) -> bool:
        """Whether the device bears no force, as far as it has told."""
        return self.newest is None or self.newest.limp

    def switch_on(self) -> None:
        """Switch the motors on with the next exchange."""
        self._motors = True

    def close(self) -> None:
        """Leave no force, and close the device; one that hangs in a call is left alone."""
        self._ended = True
        self._wake.set()
        self._thread.join(_JOIN_S)

    def _raise_priority(self) -> None:
        """Set the thread one priority above the calling one, if that is real-time, as it waits for the thread."""
        if os.sched_getscheduler(0) != os.SCHED_FIFO or self._thread.native_id is None:
            return
        self._is_raised = True
        above = os.sched_param(os.sched_getparam(0).sched_priority + 1)
        with contextlib.suppress(OSError):  # not permitted: it is then late at times
            os.sched_setscheduler(self._thread.native_id, os.SCHED_FIFO, above)

    def _run(self) -> None:
        while not self._ended:
            if self._wake.wait(1e-9 * STALE_NS):
                self._wake.clear()
                self._exchange()
            elif self._motors:
                self._push(NO_FORCE, 0.0)
        self._push(NO_FORCE, 0.0)
        self.device.switch(on=False)
        self.device.library.c.dhdClose(self.device.handle)
        self.lost = self.lost or "is closed"

    def _exchange(self) -> None:
        asked_ns, force_n = self._order
        grip_ns, grip_n = self._grip
        now_ns = self._clock.monotonic_ns()
        trusted = force_n if now_ns - asked_ns <= STALE_NS else NO_FORCE
        problem = self._push(trusted, grip_n if now_ns - grip_ns <= STALE_NS else 0.0)
        self._gripped_ns = grip_ns
        sample = self.device.read_sample()
        if problem and not sample.problem:
            sample = DhdSample(None, None, None, sample.buttons, sample.calibrated, problem, sample.prompt, limp=True)
        self.newest, self.newest_ns = sample, now_ns
        if self.answered < self.asked:
            self.answers.append((asked_ns, sample))
            self.answered = self.asked

    def _push(self, force_n: Vector3, grip_n: float) -> str:
        if not self._motors:
            return ""
        return self.device.push(force_n, grip_n) or self.device.switch(on=True)


class _Shared:
    """A server with which parts of its device are used: its arm, its gripper."""

    def __init__(self, server: DeviceServer, part: str) -> None:
        self.server, self.parts = server, {part}


_servers: dict[tuple[str, int | None], _Shared] = {}
_lock = threading.Lock()


def join_server(path: str, serial: int | None, gravity: bool, part: str, where: str, clock: Clock) -> DeviceServer:
    """Return the server of a device, which is opened unless the other of arm and gripper has it open.

    A device with a problem is opened anew. Raises DeviceError: one sentence; also if another instrument has the part.
    """
    with _lock:
        shared = _servers.get((path, serial))
        if shared is not None and part in shared.parts:
            raise DeviceError(f"{where}: another instrument has this {part}: name each by its `serial`")
        if shared is None:
            server = DeviceServer(DhdLibrary(path, where), serial, gravity, where, clock)
            _servers[path, serial] = _Shared(server, part)
            return server
        if shared.server.lost or _has_problem(shared.server):
            shared.server.close()
            shared.server = DeviceServer(DhdLibrary(path, where), serial, gravity, where, clock)
        shared.parts.add(part)
        return shared.server


def current_server(path: str, serial: int | None, last: DeviceServer) -> DeviceServer:
    """Return the server that serves a device now: another than the last, if it was opened anew."""
    shared = _servers.get((path, serial))
    return last if shared is None else shared.server


def leave_server(path: str, serial: int | None, part: str) -> None:
    """End the use of a part of a device; the last closes it. Without use nothing happens."""
    with _lock:
        shared = _servers.get((path, serial))
        if shared is None or part not in shared.parts:
            return
        shared.parts.discard(part)
        if not shared.parts:
            del _servers[path, serial]
            shared.server.close()


def _has_problem(server: DeviceServer) -> bool:
    return server.newest is not None and bool(server.newest.problem)


def as_answer(asked_ns: int, sample: DhdSample, roll_rad: float, shown: str, centre_m: Vector3) -> ArmAnswer:
    """Return a sample as an arm's answer; sentences get their subject, and places the middle as origin."""
    place = None
    if sample.place_m is not None:
        x, y, z = (part - middle for part, middle in zip(sample.place_m, centre_m, strict=True))
        place = (x, y, z)
    problem = f"{shown} {sample.problem}" if sample.problem else ""
    prompt = f"{shown} {sample.prompt}" if sample.prompt else ""
    return ArmAnswer(asked_ns, place, roll_rad, sample.buttons, sample.calibrated, problem, prompt, sample.limp)
