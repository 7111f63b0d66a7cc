"""Scheduling class of a loop: SCHED_FIFO on its core, or niceness -20 where the machine refuses that, with the reason.

FIFO is refused without CAP_SYS_NICE or an rtprio limit. Where the kernel groups real-time tasks (containers on cgroup
v1) it is not taken either if the group's budget is smaller than the loop's share, since beyond its budget the whole
group is stopped for the rest of each second. Niceness -20 goes before all other ordinary threads, but has to share the
core with them; the automatic group of the process' session gets it too.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from trocar.services.runtime.realtime.autogroup import set_group_niceness

#: The least niceness that there is: Linux, `setpriority(2)`.
LEAST_NICENESS = -20
_REFUSED = "refused (needs CAP_SYS_NICE or an rtprio limit)"


@dataclass(frozen=True, slots=True)
class SchedulingRequest:
    """Request of a loop: FIFO `priority`, and the `share` of a core that a budget of its group has to cover."""

    priority: int
    share: float


@dataclass(slots=True)
class Scheduling:
    """The scheduling class of this process.

    Attributes:
        had: str. The granted class.
        refused: list of str. Refused classes with reasons.
        is_fifo: bool. Whether FIFO was granted.
    """

    requested: SchedulingRequest
    had: str = "OTHER"
    refused: list[str] = field(default_factory=list)
    is_fifo: bool = False

    @classmethod
    def request(cls, requested: SchedulingRequest) -> Scheduling:
        """Determine what is granted. The calling thread keeps only FIFO, which later threads inherit."""
        niceness = os.getpriority(os.PRIO_PROCESS, 0)
        found = cls(requested)
        found.resume()
        if not found.is_fifo:
            _set_niceness(niceness)
        return found

    def relax(self) -> None:
        """Make only the calling thread an ordinary one, for work before its loop."""
        if self.is_fifo:
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))

    def resume(self, *, alone: bool = False) -> None:
        """Take the best class that is granted; with `alone`, processes that this thread starts are ordinary."""
        self.had, self.refused, self.is_fifo = "OTHER", [], False
        flag = os.SCHED_RESET_ON_FORK if alone else 0
        try:
            self.had = self._take_fifo(flag)
            self.is_fifo = True
            return
        except OSError as error:
            self.refused.append(f"fifo: {_reason_of(error)}")
        try:
            self.had = _take_niceness(flag)
        except OSError as error:
            self.refused.append(f"nice: {_reason_of(error)}")

    def _take_fifo(self, flag: int) -> str:
        budget = group_budget()
        if budget is not None and budget < self.requested.share:
            raise OSError(f"its group has {100 * budget:.0f} % of a core, {100 * self.requested.share:.0f} needed")
        os.sched_setscheduler(0, os.SCHED_FIFO | flag, os.sched_param(self.requested.priority))
        return f"FIFO {self.requested.priority}"


def _take_niceness(flag: int) -> str:
    _set_niceness(LEAST_NICENESS)
    os.sched_setscheduler(0, os.SCHED_OTHER | flag, os.sched_param(0))
    return f"nice {LEAST_NICENESS}"


def _reason_of(error: OSError) -> str:
    return _REFUSED if isinstance(error, PermissionError) else error.strerror or str(error)


def _set_niceness(niceness: int) -> None:
    """Set the niceness of all threads of this process, and of the group of its session."""
    _call_for_each(lambda thread: os.setpriority(os.PRIO_PROCESS, thread, niceness))
    set_group_niceness(niceness)


def step_aside() -> None:
    """Yield to threads of the caller's priority: ZeroMQ's, which inherited it and has something to send."""
    os.sched_yield()


def own_threads() -> list[int]:
    """Return the ids of this process' threads."""
    return sorted(int(task.name) for task in Path("/proc/self/task").iterdir())


def _call_for_each(do: Callable[[int], object]) -> None:
    """Call a function for each of this process' threads, ignoring those that end meanwhile."""
    for thread in own_threads():
        with contextlib.suppress(ProcessLookupError):
            do(thread)


def group_budget() -> float | None:
    """Return the real-time budget of this process' group, as a share of a core; None without such groups."""
    for folder in _group_folders():
        runtime, period = folder / "cpu.rt_runtime_us", folder / "cpu.rt_period_us"
        if runtime.is_file():
            runtime_us = int(runtime.read_text())
            return 1.0 if runtime_us < 0 else runtime_us / int(period.read_text())
    return None


def _group_folders(mount: Path = Path("/sys/fs/cgroup/cpu"), of: Path = Path("/proc/self/cgroup")) -> list[Path]:
    """Return the possible paths of the group: by its own name, or, in a container, the root of the mount."""
    lines = of.read_text().splitlines() if of.is_file() else []
    names = [line.split(":", 2)[2] for line in lines if "cpu" in line.split(":")[1].split(",")]
    return [*(mount / name.lstrip("/") for name in names), mount]
