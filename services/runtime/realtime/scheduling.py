"""The ladder of scheduling classes: a loop takes the best one that the machine grants, and reports it with reasons.

1. **FIFO**, on its core. Refused without CAP_SYS_NICE or an rtprio limit. Where the kernel groups real-time tasks
   (containers on cgroup v1) it is not taken either if the group's budget is smaller than the loop's share: beyond it
   the whole group is throttled for the rest of each second.
2. **DEADLINE** for every thread: a share of a core, guaranteed by admission, without any group's budget. The loop's is
   adapted to its need (`reservation_keeper`). Such a thread cannot be pinned (the kernel admits it to all cores of its
   root domain or to none), and its forks are ordinary (`sched(7)`, Documentation/scheduler/sched-deadline.rst).
3. **nice -20** with a slice of 0.1 ms (Linux 6.12; before, the slice is the kernel's): it precedes all others soon
   after it wakes, but has to share. The automatic group of its session gets that niceness too.
4. **plain**.
"""

from __future__ import annotations

import contextlib
import ctypes
import errno
import os
import platform
import struct
from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace
from pathlib import Path

from trocar.services.runtime.realtime.autogroup import set_group_niceness

#: `struct sched_attr` (linux/sched/types.h), first version: size, policy, flags, nice, priority, runtime, deadline,
#: period.
_ATTRIBUTES = struct.Struct("=IIQiIQQQ")
_SET_ATTRIBUTES = {"x86_64": (314, 315), "aarch64": (274, 275)}
DEADLINE = 6
_RESET_ON_FORK, _RECLAIM = 1, 2  # RECLAIM: a long tick may use time that others leave
#: Period of a share, unless the loop's is longer: a loop at 50 Hz needs its time in one piece, and after loops with
#: earlier deadlines. With longer periods for all, the earliest deadline is often another loop's.
PERIOD_NS = 1_000_000
#: Time and period (ns) of each of the other threads, ZeroMQ's two: where they carry every tick (between hosts), and
#: where the loop itself does. The latter is twice what the busiest takes in the default rig: the supervisor's 0.22 % of
#: a core, the gateway's 0.18, physics' 0.07, haptics' 0.04.
OFTEN_NS, SELDOM_NS = (10_000, PERIOD_NS), (40_000, 10 * PERIOD_NS)
#: Share of each core for all reservations: 95 %, less the 5 % that the kernel reserves since Linux 6.12 for ordinary
#: threads (its fair server). A later loop that does not fit gets the next rung.
ADMITTED = 0.9
_NICE, _SLICE_NS = -20, 100_000
RUNGS = ("fifo", "deadline", "nice")
_libc = ctypes.CDLL(None, use_errno=True)


@dataclass(frozen=True, slots=True)
class SchedulingRequest:
    """Request of a loop: FIFO `priority`, initial `share` of a core for DEADLINE, core, and rungs to try.

    `beside_ns` is what DEADLINE reserves for each other thread: time and period.
    """

    priority: int
    share: float
    core: int | None = None
    rungs: tuple[str, ...] = RUNGS
    beside_ns: tuple[int, int] = OFTEN_NS


@dataclass(slots=True)
class Scheduling:
    """The rung of this process on the ladder.

    Attributes:
        had: str. The granted rung.
        refused: list of str. Refused rungs with reasons.
    """

    requested: SchedulingRequest
    had: str = "OTHER"
    refused: list[str] = field(default_factory=list)
    _rung: int = 0
    _cores: frozenset[int] = frozenset()
    _niceness: int = 0
    _period_ns: int = PERIOD_NS
    _alone: bool = False

    @classmethod
    def request(cls, requested: SchedulingRequest) -> Scheduling:
        """Determine what is granted. The calling thread keeps only FIFO, which later threads inherit."""
        found = cls(requested, _cores=frozenset(os.sched_getaffinity(0)), _niceness=os.getpriority(os.PRIO_PROCESS, 0))
        found._climb(reset=False)
        if not found.is_fifo:
            _make_ordinary(found._niceness)
        return found

    @property
    def is_fifo(self) -> bool:
        """Whether FIFO was granted."""
        return self._name == "fifo"

    @property
    def is_pinned(self) -> bool:
        """Whether the process may be pinned to one core."""
        return self._name != "deadline"

    @property
    def _name(self) -> str:
        return (*self.requested.rungs, "plain")[self._rung]

    def relax(self) -> None:
        """Make only the calling thread an ordinary one, for work before its loop."""
        if self.is_fifo:
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))

    def resume(self, *, alone: bool = False, period_ns: int = PERIOD_NS) -> None:
        """Apply the granted rung for the loop, to all threads, or with `alone` not to threads that this one starts.

        `period_ns` is the loop's; DEADLINE grants a share of it, or of a millisecond if that is longer. A granted share
        may have been taken by others meanwhile; the next rung is then used.
        """
        self._period_ns, self._alone = max(PERIOD_NS, period_ns), alone
        self._climb(reset=alone)

    @property
    def reserves(self) -> bool:
        """Whether a share of a core was granted."""
        return self._name == "deadline"

    @property
    def may_reserve(self) -> bool:
        """Whether a share can be granted if there is room."""
        return "deadline" in self.requested.rungs[: self._rung + 1] and not any(
            refusal.startswith("deadline") and _WHY[errno.EBUSY] not in refusal for refusal in self.refused
        )

    def reserve(self, share: float, period_ns: int) -> bool:
        """Reserve this share of a core for the calling thread, also from a lower class; return whether it was admitted.

        The reserved time is granted in each `period_ns`, or each millisecond if that is longer.
        """
        before, self.requested = self.requested, replace(self.requested, share=share)
        niceness = os.getpriority(os.PRIO_PROCESS, 0)
        self._period_ns = max(PERIOD_NS, period_ns)
        try:
            if self.reserves:
                self.had = self._reserve(_own_thread(), share)
            else:
                self._look_for_room(share)
                self.had = self._deadline(self._alone)
                self._rung = self.requested.rungs.index("deadline")
        except OSError:
            self.requested = before
            if not self.reserves and os.getpriority(os.PRIO_PROCESS, 0) != niceness:  # no room for the other threads
                self._climb(reset=self._alone)
            return False
        self.refused = [refusal for refusal in self.refused if not refusal.startswith("deadline")]
        return True

    def _look_for_room(self, share: float) -> None:
        """Reserve it for this thread alone; a refusal is cheap and changes nothing."""
        pinned = os.sched_getaffinity(0)
        os.sched_setaffinity(0, self._cores)
        try:
            self._reserve(_own_thread(), share)
        except OSError:
            os.sched_setaffinity(0, pinned)
            raise

    def step_down(self) -> None:
        """Take the class after DEADLINE, as the available share is too small."""
        self.refused.append(f"deadline: {_WHY[errno.EBUSY]}")
        self._rung += 1
        _make_ordinary(self._niceness)
        self._climb(reset=self._alone)

    def _climb(self, *, reset: bool) -> None:
        while self._rung < len(self.requested.rungs):
            try:
                self.had = self._take(reset)
                return
            except OSError as error:
                self.refused.append(f"{self._name}: {error.strerror or error}")
            self._rung += 1
        self.had = "OTHER"

    def _take(self, reset: bool) -> str:
        match self._name:
            case "fifo":
                return self._fifo(reset)
            case "deadline":
                return self._deadline(reset)
            case _:
                return self._nice(reset)

    def _fifo(self, reset: bool) -> str:
        budget = group_budget()
        if budget is not None and budget < self.requested.share:
            raise OSError(
                errno.EPERM, f"its group has {100 * budget:.0f} % of a core, {100 * self.requested.share:.0f} needed"
            )
        policy = os.SCHED_FIFO | (os.SCHED_RESET_ON_FORK if reset else 0)
        os.sched_setscheduler(0, policy, os.sched_param(self.requested.priority))
        return f"FIFO {self.requested.priority}"

    def _deadline(self, reset: bool) -> str:
        pinned, own = os.sched_getaffinity(0), _own_thread()
        try:
            _pin_all(self._cores)
            _of_each(lambda thread: _reserve_ns(thread, *self.requested.beside_ns), but=own)
            return self._reserve(own, self.requested.share)
        except OSError:
            _make_ordinary(self._niceness)
            _pin_all(pinned)
            raise

    def _reserve(self, thread: int, share: float) -> str:
        _reserve_ns(thread, round(share * self._period_ns), self._period_ns)
        return f"DEADLINE {100 * share:.0f} % of a core"

    def _nice(self, reset: bool) -> str:
        if self.requested.core in self._cores:
            _pin_all({self.requested.core})
        flags = _RESET_ON_FORK if reset else 0
        _of_each(lambda thread: set_attributes(thread, os.SCHED_OTHER, flags, nice=_NICE, runtime_ns=_SLICE_NS))
        set_group_niceness(_NICE)
        slice_ns = get_attributes(0)[5]
        return f"nice {_NICE}, slice {slice_ns / 1e6:g} ms" if slice_ns else f"nice {_NICE}, the kernel's slice"


def step_aside() -> None:
    """Yield to threads of the caller's priority: ZeroMQ's, which inherited it and has something to send.

    With SCHED_DEADLINE this does nothing, as `sched_yield(2)` there gives up the rest of the budget until the next
    period: each report lost a tick, ten a second of each loop. Other threads have budgets of their own.
    """
    if os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK != DEADLINE:
        os.sched_yield()


def _reserve_ns(thread: int, runtime_ns: int, period_ns: int) -> None:
    set_attributes(thread, DEADLINE, _RESET_ON_FORK | _RECLAIM, runtime_ns=runtime_ns, period_ns=period_ns)


def _own_thread() -> int:
    import threading

    return threading.get_native_id()


def own_threads() -> list[int]:
    """Return the ids of this process' threads."""
    return sorted(int(task.name) for task in Path("/proc/self/task").iterdir())


def _of_each(do: Callable[[int], object], but: int = 0) -> None:
    """Call a function for each of this process' threads `but` one, ignoring those that end meanwhile."""
    for thread in (each for each in own_threads() if each != but):
        with contextlib.suppress(ProcessLookupError):
            do(thread)


def _pin_all(cores: Collection[int]) -> None:
    _of_each(lambda thread: os.sched_setaffinity(thread, cores))


def _make_ordinary(niceness: int) -> None:
    _of_each(lambda thread: set_attributes(thread, os.SCHED_OTHER, 0, nice=niceness))
    set_group_niceness(niceness)


def set_attributes(
    thread: int,
    policy: int,
    flags: int,
    *,
    nice: int = 0,
    runtime_ns: int = 0,
    period_ns: int = PERIOD_NS,
    deadline_ns: int = 0,
) -> None:
    """Call ``sched_setattr(2)``, which neither Python nor every C library has; the period is only for DEADLINE.

    `deadline_ns` is the deadline within each period, 0 for its end.
    Raises OSError if the kernel refuses.
    """
    period_ns = period_ns if policy == DEADLINE else 0
    due_ns = deadline_ns or period_ns
    attributes = _ATTRIBUTES.pack(_ATTRIBUTES.size, policy, flags, nice, 0, runtime_ns, due_ns, period_ns)
    _call(0, thread, attributes, 0)


def get_attributes(thread: int) -> tuple[int, ...]:
    """Return size, policy, flags, nice, priority, runtime, deadline and period of a thread, by the kernel."""
    attributes = ctypes.create_string_buffer(_ATTRIBUTES.size)
    _call(1, thread, attributes, _ATTRIBUTES.size, 0)
    return _ATTRIBUTES.unpack(attributes.raw)


def _call(which: int, *arguments: object) -> None:
    numbers = _SET_ATTRIBUTES.get(platform.machine())
    if numbers is None:
        raise OSError(errno.ENOSYS, f"not known on {platform.machine()}")
    if _libc.syscall(numbers[which], *arguments):
        number = ctypes.get_errno()
        raise OSError(number, _WHY.get(number, os.strerror(number)))


_WHY = {
    errno.EPERM: "refused (needs CAP_SYS_NICE; DEADLINE also all cores of the machine)",
    errno.EBUSY: "no room: what others reserve and this is more than the machine has",
}


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


def rungs_granted(requested: SchedulingRequest) -> dict[str, str]:
    """Return each rung with its result or the reason of refusal; this changes the process' scheduling."""
    found: dict[str, str] = {}
    for name in RUNGS:
        asked = Scheduling.request(replace(requested, rungs=(name,)))
        asked.resume()
        found[name] = f"granted ({asked.had})" if not asked.refused else asked.refused[0].partition(": ")[2]
        _make_ordinary(asked._niceness)  # noqa: SLF001
    return found
