"""What the kernel says of a process: that a signal holds it, or that it would run if others let it.

Both look like a hang from outside. A process that is stopped is in state T; but one that others starve stays runnable
after SIGSTOP until it gets a processor to take the signal on, and the time that it waits enters its statistics only
when the wait is over. So of a runnable process it is also asked which signals it has yet to take, and since when it has
not run.
"""

from __future__ import annotations

import os
import signal
from typing import NamedTuple

from services.supervisor.runqueue_waits import BusWaits, ThreadWait, read

_STOPPING = sum(1 << (number - 1) for number in (signal.SIGSTOP, signal.SIGTSTP, signal.SIGTTIN, signal.SIGTTOU))
_PENDING = (b"SigPnd:", b"ShdPnd:")


class Waits(NamedTuple):
    """For how long a process has waited for a processor, s: its loop, and the threads that send for it.

    A heartbeat waits with the one, then with the others. Where they wait at the same time, both together are more than
    the silence that they explain.
    """

    loop_s: float = 0.0
    bus_s: float = 0.0

    @property
    def total_s(self) -> float:
        """Both together."""
        return self.loop_s + self.bus_s

    def since(self, earlier: Waits) -> Waits:
        """Return what has been waited since."""
        return Waits(self.loop_s - earlier.loop_s, self.bus_s - earlier.bus_s)


class KernelWord:
    """Files of the kernel about the process `pid`, kept open: they never speak of another that takes its number."""

    def __init__(self, pid: int) -> None:
        self._tasks = os.open(f"/proc/{pid}/task", os.O_RDONLY | os.O_DIRECTORY)
        self._status = os.open(f"/proc/{pid}/status", os.O_RDONLY)
        self._main = ThreadWait(self._tasks, pid)
        self._bus = BusWaits(self._tasks)

    def is_stopped(self) -> bool:
        """Return whether a signal or a debugger holds the process (SIGSTOP), or will when it is next run."""
        state = self._state()
        self._main.look(state)
        return state in (b"T", b"t") or (state == b"R" and self._is_to_stop())

    def waits(self) -> Waits:
        """Return for how long its loop and its bus have waited for a processor since their start, 0 where unknown."""
        state = self._state()
        if not state:
            return Waits()
        self._main.look(state)
        return Waits(self._main.waited_s(), self._bus.waited_s())

    def close(self) -> None:
        """Let go of the files."""
        self._main.close()
        self._bus.close()
        os.close(self._status)
        os.close(self._tasks)

    def _state(self) -> bytes:
        return self._main.state()

    def _is_to_stop(self) -> bool:
        """Return whether a stop signal is pending, for its main thread or for whichever is run first."""
        lines = (line.split() for line in read(self._status).splitlines() if line.startswith(_PENDING))
        return any(int(line[1], 16) & _STOPPING for line in lines)
