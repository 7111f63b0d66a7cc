"""What the kernel says of a process: that a signal holds it, or that it would run if others let it.

Both look like a hang from outside. A process that is stopped is in state T; but one that others starve stays runnable
after SIGSTOP until it gets a processor to take the signal on, and the time that it waits enters its statistics only
when the wait is over. So of a runnable process it is also asked which signals it has yet to take, and since when it has
not run.
"""

from __future__ import annotations

import os
import signal
import time

_STOPPING = sum(1 << (number - 1) for number in (signal.SIGSTOP, signal.SIGTSTP, signal.SIGTTIN, signal.SIGTTOU))
_PENDING = (b"SigPnd:", b"ShdPnd:")


class KernelWord:
    """Files of the kernel about the process `pid`, kept open: they never speak of another that takes its number."""

    def __init__(self, pid: int) -> None:
        self._stat = os.open(f"/proc/{pid}/stat", os.O_RDONLY)
        self._status = os.open(f"/proc/{pid}/status", os.O_RDONLY)
        self._schedule = _open_if_there(f"/proc/{pid}/schedstat")
        self._ran_ns = -1
        self._looked_s = 0.0
        self._waiting_since_s: float | None = None

    def is_stopped(self) -> bool:
        """Return whether a signal or a debugger holds the process (SIGSTOP), or will when it is next run."""
        state = self._state()
        self._look(state)
        return state in (b"T", b"t") or (state == b"R" and self._is_to_stop())

    def waited_s(self) -> float:
        """Return for how long the main thread has waited for a processor since its start, 0 where unknown.

        A wait that goes on counts from when it was last looked at, by this or `is_stopped`, and had run since.
        """
        waited_s = self._look(self._state())
        return waited_s if self._waiting_since_s is None else waited_s + time.monotonic() - self._waiting_since_s

    def close(self) -> None:
        """Let go of the files."""
        for file in (self._stat, self._status, self._schedule):
            if file is not None:
                os.close(file)

    def _state(self) -> bytes:
        text = _read(self._stat).rpartition(b")")[2].split(maxsplit=1)
        return text[0] if text else b""

    def _is_to_stop(self) -> bool:
        """Return whether a stop signal is pending, for its main thread or for whichever is run first."""
        lines = (line.split() for line in _read(self._status).splitlines() if line.startswith(_PENDING))
        return any(int(line[1], 16) & _STOPPING for line in lines)

    def _look(self, state: bytes) -> float:
        """Find out whether it waits now; return for how long it waited before."""
        words = b"" if self._schedule is None else _read(self._schedule)
        ran_ns, waited_ns = map(int, words.split()[:2]) if words else (self._ran_ns + 1, 0)
        if state != b"R" or ran_ns != self._ran_ns:
            self._waiting_since_s = None
        elif self._waiting_since_s is None:
            self._waiting_since_s = self._looked_s
        self._ran_ns, self._looked_s = ran_ns, time.monotonic()
        return waited_ns * 1e-9


def _read(file: int) -> bytes:
    """Return what a file says, nothing of a process that has ended."""
    try:
        return os.pread(file, 4096, 0)
    except OSError:
        return b""


def _open_if_there(path: str) -> int | None:
    """Return a descriptor of a file that not every kernel has."""
    try:
        return os.open(path, os.O_RDONLY)
    except FileNotFoundError:
        return None
