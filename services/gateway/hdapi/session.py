"""A loaded HDAPI in this process: its devices, its scheduler, and the callback that serves all arms.

A library is loaded once and never unloaded, since it fails when it is loaded again. Devices can only be added while
the scheduler is stopped, so opening a second arm, or reopening one, stops it for a moment; closing the last arm stops
it for good.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import os
from pathlib import Path

import numpy as np

from trocar.protocol.topics import TICK_HZ
from trocar.services.gateway.devices.clock import Clock
from trocar.services.gateway.hdapi.cells import ArmCell, Functions, ServoCell
from trocar.services.gateway.hdapi.constants import MAX_SCHEDULER_PRIORITY, describe
from trocar.services.gateway.hdapi.error_stack import unreachable
from trocar.services.gateway.hdapi.library import HdapiLibrary
from trocar.services.gateway.hdapi.open_arm import ArmTerms, OpenArm, find_functions, open_arm
from trocar.services.gateway.hdapi.reopening import Reopening
from trocar.services.gateway.hdapi.servo_callback import callback, claim_cell
from trocar.services.runtime.errors import DeviceError

RATE_HZ = round(TICK_HZ)
#: Longest time of a call that is under way when the scheduler has been stopped: a hundred times a frame.
_UNDER_WAY_NS = 100_000_000


class Session:
    """The devices of one library; not thread-safe."""

    def __init__(self, library: HdapiLibrary, clock: Clock) -> None:
        self._library, self._clock = library, clock
        self._functions = find_functions(library, clock)
        self._arms: dict[str | None, OpenArm] = {}
        self._users: set[str | None] = set()
        self._servo: ServoCell | None = None
        self._scheduled = 0
        self._threads: list[int] = []
        self._is_raised = False
        self._reopening: Reopening | None = None

    def join(self, name: str | None, terms: ArmTerms, where: str) -> OpenArm:
        """Open the arm named `name` in the vendor's set-up, motors off, and serve it from now on.

        Raises DeviceError: one sentence, if it is missing or used by another instrument.
        """
        self._settle_reopening()
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
        """Close an arm, whose motors are off; the last one stops the scheduler and closes all devices."""
        self._settle_reopening()
        self._users.discard(name)
        if self._users or not self._arms:
            return
        self._stop()
        for arm in self._arms.values():
            self._library.c.hdDisableDevice(arm.cell.handle)
        self._library.take_error()
        self._arms.clear()

    def serves(self, arm: OpenArm) -> bool:
        """Return whether the scheduler serves an arm, reachable or not."""
        return any(each is arm for each in self._arms.values())

    @property
    def is_pausing(self) -> bool:
        """Whether no arm is served now because one is being reopened."""
        return self._reopening is not None and self._reopening.is_pause

    def reopen(self, name: str | None, terms: ArmTerms, where: str, armed: int) -> Reopening | None:
        """Start reopening an unreachable arm, or restarting a scheduler that has ended.

        All other arms are released meanwhile, and return as described in `applied_force`.

        Args:
            armed: How often a person has armed the rig so far, which does not confirm the posture of the reopened arm.

        Returns:
            Reopening or None: whose `go_on` is to be called; None while another arm is being reopened.
        """
        if self._reopening is not None and not self._reopening.ended:
            return None
        cells = [each.cell for each in self._arms.values()]
        self._reopening = Reopening(
            self._servo, cells, functools.partial(self._reopen, name, terms, where, armed), self._clock
        )
        return self._reopening

    def _reopen(self, name: str | None, terms: ArmTerms, where: str, armed: int) -> OpenArm:
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

    def _settle_reopening(self) -> None:
        if self._reopening is not None:
            self._reopening.give_up()

    def raise_priority(self) -> bool:
        """Set the scheduler's thread one priority above the calling one; return whether the latter is real-time.

        The thread was started by a process that was not real-time yet, and shares the gateway's core. A thread made
        real-time by the library itself is left unchanged.
        """
        if self._is_raised:
            return True
        if os.sched_getscheduler(0) != os.SCHED_FIFO:
            return False
        self._is_raised = True
        above = os.sched_param(os.sched_getparam(0).sched_priority + 1)
        for thread in self._threads:
            with contextlib.suppress(OSError):  # gone, or not permitted: it is then late at times
                if os.sched_getscheduler(thread) == os.SCHED_OTHER:
                    os.sched_setscheduler(thread, os.SCHED_FIFO, above)
        return True

    def _start(self, where: str) -> None:
        if not self._arms:
            return
        library = self._library
        cells = [arm.cell for arm in self._arms.values()]
        self._servo = _servo(self._functions, cells)
        _keep_forever((self._servo, cells))
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
        """Stop the scheduler, and take the cell from a thread of the library that still calls afterwards."""
        if self._servo is None:
            return
        self._library.c.hdStopScheduler()
        self._retire(self._servo)
        self._library.c.hdUnschedule(self._scheduled)
        self._library.take_error()  # of a callback that has ended by itself and is not scheduled
        self._servo = None

    def _retire(self, servo: ServoCell) -> None:
        """Claim the cell for good: a call that is under way ends first, and a later one returns at once."""
        until_ns = self._clock.monotonic_ns() + _UNDER_WAY_NS
        while not claim_cell(servo.address) and self._clock.monotonic_ns() < until_ns:
            self._clock.sleep(1e-4)


def _keep_forever(cells: object) -> None:
    """Let the memory of cells live as long as the process, its end included.

    A library's thread may outlive `hdStopScheduler`, and still call with their address. A start takes a few kilobytes,
    and is the work of a person.
    """
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(cells))


_sessions: dict[str, Session] = {}


def find_session(path: str, clock: Clock, where: str) -> Session:
    """Return the session of a library, which the first call loads.

    Raises DeviceError: one sentence, if it cannot be loaded.
    """
    if path not in _sessions:
        _sessions[path] = Session(HdapiLibrary(path, where), clock)
    return _sessions[path]


def _servo(functions: Functions, arms: list[ArmCell]) -> ServoCell:
    time, busy = np.zeros(2, np.int64), np.zeros(1, np.int64)
    return ServoCell(
        functions=functions,
        arms=np.array([arm.address for arm in arms], np.int64),
        time=time,
        time_at=time.ctypes.data,
        busy=busy,
        busy_at=busy.ctypes.data,
    )


def _threads() -> set[int]:
    return {int(task.name) for task in Path("/proc/self/task").iterdir()}
