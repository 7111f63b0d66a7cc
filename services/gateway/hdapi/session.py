"""The life of a loaded HDAPI in this process: its devices, its scheduler, the one callback that serves all arms.

A library is loaded once and never given back, since it fails when it is loaded again. Devices can only be added while
the scheduler stands, so opening a second arm, or one anew, stops it for a moment; the last one to leave stops it for
good.
"""

from __future__ import annotations

import contextlib
import functools
import os
from pathlib import Path

import numpy as np

from services.gateway.clock import Clock
from services.gateway.hdapi.cells import ArmCell, Functions, ServoCell
from services.gateway.hdapi.constants import MAX_SCHEDULER_PRIORITY, describe
from services.gateway.hdapi.error_stack import unreachable
from services.gateway.hdapi.library import Library
from services.gateway.hdapi.open_arm import OpenArm, Terms, find_functions, open_arm
from services.gateway.hdapi.reopening import Reopening
from services.gateway.hdapi.servo_callback import callback
from services.runtime.errors import DeviceError

RATE_HZ = 1000


class Session:
    """The devices of one library. Not for use by two threads."""

    def __init__(self, library: Library, clock: Clock) -> None:
        self._library, self._clock = library, clock
        self._functions = find_functions(library, clock)
        self._arms: dict[str | None, OpenArm] = {}
        self._users: set[str | None] = set()
        self._servo: ServoCell | None = None
        self._scheduled = 0
        self._threads: list[int] = []
        self._is_raised = False
        self._reopening: Reopening | None = None

    def join(self, name: str | None, terms: Terms, where: str) -> OpenArm:
        """Return the arm that the vendor's set-up calls `name`, served from now on; its motors are off.

        Raises DeviceError: one sentence, if it is not there or another instrument has it.
        """
        self._settle()
        if name in self._users:
            shown = "the default device" if name is None else f"device {name!r}"
            raise DeviceError(f"{where}: {shown} is another instrument's; `settings: {{name: ...}}` tells them apart")
        if name not in self._arms:
            self._stop()
            try:
                self._arms[name] = open_arm(self._library, name, terms, where)
            finally:
                self._start(where)
        self._users.add(name)
        return self._arms[name]

    def leave(self, name: str | None) -> None:
        """Give an arm up, whose motors are off; the last one stops the scheduler and closes all devices."""
        self._settle()
        self._users.discard(name)
        if self._users or not self._arms:
            return
        self._stop()
        for arm in self._arms.values():
            self._library.c.hdDisableDevice(arm.cell.handle)
        self._library.take_error()
        self._arms.clear()

    def serves(self, arm: OpenArm) -> bool:
        """Return whether an arm is one that the scheduler calls for, though it may not be reached."""
        return any(each is arm for each in self._arms.values())

    @property
    def is_pausing(self) -> bool:
        """Whether every hand is let go, and nothing read, because an arm is just being opened anew."""
        return self._reopening is not None and self._reopening.is_pause

    def reopen(self, name: str | None, terms: Terms, where: str, armed: int) -> Reopening | None:
        """Begin to open an arm anew that cannot be reached, or to start a scheduler that has ended.

        Every other hand is let go meanwhile, and comes back as after a doubt: see `applied_force`.

        Args:
            armed: How often a person has armed the rig so far: that is no word on the posture of the arm as it is
                opened.

        Returns:
            Reopening or None: to be asked to `go_on`; none while another arm is being opened.
        """
        if self._reopening is not None and not self._reopening.ended:
            return None
        cells = [each.cell for each in self._arms.values()]
        self._reopening = Reopening(
            self._servo, cells, functools.partial(self._open_anew, name, terms, where, armed), self._clock
        )
        return self._reopening

    def _open_anew(self, name: str | None, terms: Terms, where: str, armed: int) -> OpenArm:
        self._stop()
        arm = self._arms.get(name)
        try:
            if arm is not None and unreachable(arm.cell.error):
                del self._arms[name]
                self._library.c.hdDisableDevice(arm.cell.handle)
                arm = None
            if arm is None:
                arm = self._arms[name] = open_arm(self._library, name, terms, where)
                arm.cell.armed = float(armed)
            return arm
        finally:
            self._start(where)

    def _settle(self) -> None:
        if self._reopening is not None:
            self._reopening.give_up()

    def raise_priority(self) -> bool:
        """Put the scheduler's thread one above the calling one; return whether that is real-time by now.

        The process that started it was an ordinary one still, and it shares the gateway's core. A thread that the
        library has made real-time itself stays as it is.
        """
        if self._is_raised:
            return True
        if os.sched_getscheduler(0) != os.SCHED_FIFO:
            return False
        self._is_raised = True
        above = os.sched_param(os.sched_getparam(0).sched_priority + 1)
        for thread in self._threads:
            with contextlib.suppress(OSError):  # gone, or not allowed: then it stays as it is, and is late at times
                if os.sched_getscheduler(thread) == os.SCHED_OTHER:
                    os.sched_setscheduler(thread, os.SCHED_FIFO, above)
        return True

    def _start(self, where: str) -> None:
        if not self._arms:
            return
        library = self._library
        self._servo = _servo(self._functions, [arm.cell for arm in self._arms.values()])
        library.take_error()
        self._scheduled = library.c.hdScheduleAsynchronous(
            callback().address, self._servo.address, MAX_SCHEDULER_PRIORITY
        )
        library.c.hdSetSchedulerRate(RATE_HZ)
        before = _threads()
        library.c.hdStartScheduler()
        self._threads = sorted(_threads() - before)
        self._is_raised = False
        error = library.take_error()
        if error:
            raise DeviceError(f"{where}: the scheduler of OpenHaptics does not start: {describe(error)}")

    def _stop(self) -> None:
        if self._servo is None:
            return
        self._library.c.hdStopScheduler()
        self._library.c.hdUnschedule(self._scheduled)
        self._library.take_error()  # a callback that has ended by itself is not scheduled any more
        self._servo = None


_sessions: dict[str, Session] = {}


def find_session(path: str, clock: Clock, where: str) -> Session:
    """Return the session of a library, loaded by the first who asks.

    Raises DeviceError: one sentence, if it cannot be loaded.
    """
    if path not in _sessions:
        _sessions[path] = Session(Library(path, where), clock)
    return _sessions[path]


def _servo(functions: Functions, arms: list[ArmCell]) -> ServoCell:
    time = np.zeros(2, np.int64)
    return ServoCell(
        functions=functions,
        arms=np.array([arm.address for arm in arms], np.int64),
        time=time,
        time_at=time.ctypes.data,
    )


def _threads() -> set[int]:
    return {int(task.name) for task in Path("/proc/self/task").iterdir()}
