"""State of a process by the kernel: stopped by a signal, or runnable and waiting for a processor.

Both look like a hang from outside. A stopped process is in state T. But a starved one remains runnable after SIGSTOP
until it gets a processor on which to handle the signal, and its waits enter its statistics only when they end. So for a
runnable process the pending signals, and the time since it last ran, are read as well.
"""

from __future__ import annotations

import os
import signal
from typing import NamedTuple

from trocar.services.supervisor.crew.runqueue_waits import BusWaits, ThreadWait, read

_STOPPING = sum(1 << (number - 1) for number in (signal.SIGSTOP, signal.SIGTSTP, signal.SIGTTIN, signal.SIGTTOU))
_PENDING = (b"SigPnd:", b"ShdPnd:")


class Waits(NamedTuple):
    """Waits for a processor, in s, of a process' loop and of the threads that send for it.

    A heartbeat waits first with the loop, then with the others. If they wait simultaneously, the sum exceeds the
    silence that it explains.
    """

    loop_s: float = 0.0
    bus_s: float = 0.0

    @property
    def total_s(self) -> float:
        """Sum of both."""
        return self.loop_s + self.bus_s

    def since(self, earlier: Waits) -> Waits:
        """Return the waits since an earlier state."""
        return Waits(self.loop_s - earlier.loop_s, self.bus_s - earlier.bus_s)


class SchedulerState:
    """The kernel's files about the process `pid`, kept open so that they never refer to a later one of the same id."""

    def __init__(self, pid: int) -> None:
        self._tasks = os.open(f"/proc/{pid}/task", os.O_RDONLY | os.O_DIRECTORY)
        self._status = os.open(f"/proc/{pid}/status", os.O_RDONLY)
        self._main = ThreadWait(self._tasks, pid)
        self._bus = BusWaits(self._tasks)

    def is_stopped(self) -> bool:
        """Return whether a signal or a debugger stops the process (SIGSTOP), or will when it next runs."""
        state = self._state()
        self._main.look(state)
        return state in (b"T", b"t") or (state == b"R" and self._is_to_stop())

    def waits(self) -> Waits:
        """Return the waits of its loop and its bus for a processor since their start, 0 if unknown."""
        state = self._state()
        if not state:
            return Waits()
        self._main.look(state)
        return Waits(self._main.waited_s(), self._bus.waited_s())

    def close(self) -> None:
        """Close the files."""
        self._main.close()
        self._bus.close()
        os.close(self._status)
        os.close(self._tasks)

    def _state(self) -> bytes:
        return self._main.state()

    def _is_to_stop(self) -> bool:
        """Return whether a stop signal is pending, for its main thread or for the process."""
        lines = (line.split() for line in read(self._status).splitlines() if line.startswith(_PENDING))
        return any(int(line[1], 16) & _STOPPING for line in lines)
