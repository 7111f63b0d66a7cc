"""The silence of a process that helps the supervisor: the page, and the fork server."""

from __future__ import annotations

import time

from trocar.protocol.topics import HEARTBEAT_S
from trocar.services.supervisor.crew.scheduler_state import SchedulerState

#: Most of the time between two looks at it that counts as its silence; the rest is a delay of our own.
_LOOK_S = 0.1


class Silence:
    """How long an answer of a process has been awaited, and for how long of that it was stopped by a signal.

    Delays of our own, and the process' waits for a processor, do not count.
    """

    def __init__(self, pid: int, patience_s: float) -> None:
        self._kernel = SchedulerState(pid)
        self.awaits = False
        self.await_answer(patience_s)

    def await_answer(self, patience_s: float) -> None:
        """Wait for an answer from now on."""
        self.awaits, self._patience_s = True, patience_s
        self._silent_s = self._stopped_s = 0.0
        self._waited_s, self._looked_s = self._kernel.waits().total_s, time.monotonic()

    def too_long(self) -> str:
        """Return what is wrong with the process, empty for nothing."""
        now_s = time.monotonic()
        passed_s, self._looked_s = min(now_s - self._looked_s, _LOOK_S), now_s
        if not self.awaits:
            return ""
        self._silent_s += passed_s
        self._stopped_s = self._stopped_s + passed_s if self._kernel.is_stopped() else 0.0
        if self._stopped_s > HEARTBEAT_S:
            return "is stopped by a signal"
        silent_s = self._silent_s - (self._kernel.waits().total_s - self._waited_s)
        return f"said nothing for {silent_s:.1f} s" if silent_s > self._patience_s else ""

    def close(self) -> None:
        """Close the kernel's files."""
        self._kernel.close()
