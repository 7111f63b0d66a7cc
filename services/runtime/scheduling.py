"""The ladder of scheduling classes: a loop takes the best that the machine grants, and says which and why.

1. **FIFO**, on its core. Refused without CAP_SYS_NICE or an rtprio limit. Where the kernel groups real-time tasks
   (containers on cgroup v1) it is not taken either if the group's budget is smaller than the loop's share: beyond it
   the whole group stands still for the rest of each second.
2. **DEADLINE** for every thread: a share of a core, guaranteed by admission; no group's budget binds it. The loop's is
   set anew when its need changes (`reservation_keeper`). Such a thread may not be pinned (the kernel admits it to all
   cores of its root domain or to none) and does not fork, so its children are ordinary (`sched(7)`,
   Documentation/scheduler/sched-deadline.rst).
3. **nice -20** with a slice of 0.1 ms (Linux 6.12; before, the slice is the kernel's): it is put before all others soon
   after it wakes, but has to share. A group that the kernel made of its session gets that niceness too.
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

from services.runtime.autogroup import set_group_niceness

#: Of `struct sched_attr` (linux/sched/types.h), first version: size, policy, flags, nice, priority, runtime, deadline,
#: period.
_ATTRIBUTES = struct.Struct("=IIQiIQQQ")
_SET_ATTRIBUTES = {"x86_64": (314, 315), "aarch64": (274, 275)}
DEADLINE = 6
_RESET_ON_FORK, _RECLAIM = 1, 2  # RECLAIM: a tick that takes longer has what others leave
#: A share is of this period, or of its loop's where that is longer: who turns fifty times a second needs its time in
#: one piece, and after those who are due sooner. With longer ones for all, the earliest deadline is often another
#: loop's.
PERIOD_NS = 1_000_000
#: Of each of the threads beside the loop's own: ZeroMQ's two.
BESIDE = 0.01
#: Of each core, for all that reserve together: 95 %, less the 5 % that the kernel reserves since Linux 6.12 so that
#: ordinary threads are never starved (its fair server). What comes last and does not fit gets the next rung.
ADMITTED = 0.9
_NICE, _SLICE_NS = -20, 100_000
RUNGS = ("fifo", "deadline", "nice")
_libc = ctypes.CDLL(None, use_errno=True)


@dataclass(frozen=True, slots=True)
class Wish:
    """What a loop asks for: FIFO `priority`; first a `share` of a core, where that is given; a core; which rungs."""

    priority: int
    share: float
    core: int | None = None
    rungs: tuple[str, ...] = RUNGS


@dataclass(slots=True)
class Scheduling:
    """The place of this process on the ladder.

    Attributes:
        had: str. What was granted.
        refused: list of str. What was not, and why.
    """

    wish: Wish
    had: str = "OTHER"
    refused: list[str] = field(default_factory=list)
    _rung: int = 0
    _cores: frozenset[int] = frozenset()
    _niceness: int = 0
    _period_ns: int = PERIOD_NS
    _alone: bool = False

    @classmethod
    def ask(cls, wish: Wish) -> Scheduling:
        """Find out what is granted. The calling thread keeps FIFO, which later threads inherit, and nothing else."""
        found = cls(wish, _cores=frozenset(os.sched_getaffinity(0)), _niceness=os.getpriority(os.PRIO_PROCESS, 0))
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
        """Whether the process may keep to one core."""
        return self._name != "deadline"

    @property
    def _name(self) -> str:
        return (*self.wish.rungs, "plain")[self._rung]

    def relax(self) -> None:
        """Make the calling thread, and it alone, an ordinary one: what it does before its loop may wait."""
        if self.is_fifo:
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))

    def resume(self, *, alone: bool = False, period_ns: int = PERIOD_NS) -> None:
        """Take for the loop what was granted: for all threads, or with `alone` for none that this one starts.

        `period_ns` is the loop's; what DEADLINE grants is a share of it, of a millisecond at least.
        What was granted before may be given to others by now (DEADLINE is admitted while there is room): then it is
        what comes next.
        """
        self._period_ns, self._alone = max(PERIOD_NS, period_ns), alone
        self._climb(reset=alone)

    @property
    def reserves(self) -> bool:
        """Whether what was granted is a share of a core."""
        return self._name == "deadline"

    @property
    def may_reserve(self) -> bool:
        """Whether a share is granted where there is room."""
        return "deadline" in self.wish.rungs[: self._rung + 1] and not any(
            refusal.startswith("deadline") and _WHY[errno.EBUSY] not in refusal for refusal in self.refused
        )

    def reserve(self, share: float, period_ns: int) -> bool:
        """Reserve this share of a core for the calling thread, from a class below, too; return whether it was admitted.

        The reserved time is had in each `period_ns`, or in the millisecond where that is longer.
        """
        before, self.wish = self.wish, replace(self.wish, share=share)
        niceness = os.getpriority(os.PRIO_PROCESS, 0)
        self._period_ns = max(PERIOD_NS, period_ns)
        try:
            if self.reserves:
                self.had = self._reserve(_own_thread(), share)
            else:
                self._look_for_room(share)
                self.had = self._deadline(self._alone)
                self._rung = self.wish.rungs.index("deadline")
        except OSError:
            self.wish = before
            if not self.reserves and os.getpriority(os.PRIO_PROCESS, 0) != niceness:  # the threads beside found none
                self._climb(reset=self._alone)
            return False
        self.refused = [refusal for refusal in self.refused if not refusal.startswith("deadline")]
        return True

    def _look_for_room(self, share: float) -> None:
        """Take it for this thread alone: where it is refused, that costs little, and nothing has changed."""
        pinned = os.sched_getaffinity(0)
        os.sched_setaffinity(0, self._cores)
        try:
            self._reserve(_own_thread(), share)
        except OSError:
            os.sched_setaffinity(0, pinned)
            raise

    def step_down(self) -> None:
        """Take the class after DEADLINE: the share that there is does not hold."""
        self.refused.append(f"deadline: {_WHY[errno.EBUSY]}")
        self._rung += 1
        _make_ordinary(self._niceness)
        self._climb(reset=self._alone)

    def _climb(self, *, reset: bool) -> None:
        while self._rung < len(self.wish.rungs):
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
        if budget is not None and budget < self.wish.share:
            raise OSError(
                errno.EPERM, f"its group has {100 * budget:.0f} % of a core, {100 * self.wish.share:.0f} needed"
            )
        policy = os.SCHED_FIFO | (os.SCHED_RESET_ON_FORK if reset else 0)
        os.sched_setscheduler(0, policy, os.sched_param(self.wish.priority))
        return f"FIFO {self.wish.priority}"

    def _deadline(self, reset: bool) -> str:
        pinned, own = os.sched_getaffinity(0), _own_thread()
        try:
            _pin_all(self._cores)
            _of_each(lambda thread: thread == own or self._reserve(thread, BESIDE))
            return self._reserve(own, self.wish.share)
        except OSError:
            _make_ordinary(self._niceness)
            _pin_all(pinned)
            raise

    def _reserve(self, thread: int, share: float) -> str:
        runtime_ns, flags = round(share * self._period_ns), _RESET_ON_FORK | _RECLAIM
        set_attributes(thread, DEADLINE, flags, runtime_ns=runtime_ns, period_ns=self._period_ns)
        return f"DEADLINE {100 * share:.0f} % of a core"

    def _nice(self, reset: bool) -> str:
        if self.wish.core in self._cores:
            _pin_all({self.wish.core})
        flags = _RESET_ON_FORK if reset else 0
        _of_each(lambda thread: set_attributes(thread, os.SCHED_OTHER, flags, nice=_NICE, runtime_ns=_SLICE_NS))
        set_group_niceness(_NICE)
        slice_ns = get_attributes(0)[5]
        return f"nice {_NICE}, slice {slice_ns / 1e6:g} ms" if slice_ns else f"nice {_NICE}, the kernel's slice"


def step_aside() -> None:
    """Let threads of the caller's priority run first: ZeroMQ's, which inherited it and has something to send.

    With SCHED_DEADLINE nothing is done. There `sched_yield(2)` gives up what is left of the budget, and the thread
    stands still until its next period: a tick was lost with every report, ten a second of each loop. The others have
    budgets of their own.
    """
    if os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK != DEADLINE:
        os.sched_yield()


def _own_thread() -> int:
    import threading

    return threading.get_native_id()


def own_threads() -> list[int]:
    """Return the numbers of this process' threads."""
    return sorted(int(task.name) for task in Path("/proc/self/task").iterdir())


def _of_each(do: Callable[[int], object]) -> None:
    """Do something to each of this process' threads that has not ended meanwhile."""
    for thread in own_threads():
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
    """Call ``sched_setattr(2)``, which neither Python nor every C library has; the period is DEADLINE's alone.

    `deadline_ns` is how soon in each period the work is to be done; 0 for at its end.
    Raises OSError if the kernel refuses.
    """
    period_ns = period_ns if policy == DEADLINE else 0
    due_ns = deadline_ns or period_ns
    attributes = _ATTRIBUTES.pack(_ATTRIBUTES.size, policy, flags, nice, 0, runtime_ns, due_ns, period_ns)
    _call(0, thread, attributes, 0)


def get_attributes(thread: int) -> tuple[int, ...]:
    """Return size, policy, flags, nice, priority, runtime, deadline and period of a thread, as the kernel has them."""
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
    """Return the share of a core that this process' group has in real time; None where there are no such groups."""
    for folder in _group_folders():
        runtime, period = folder / "cpu.rt_runtime_us", folder / "cpu.rt_period_us"
        if runtime.is_file():
            runtime_us = int(runtime.read_text())
            return 1.0 if runtime_us < 0 else runtime_us / int(period.read_text())
    return None


def _group_folders(mount: Path = Path("/sys/fs/cgroup/cpu"), of: Path = Path("/proc/self/cgroup")) -> list[Path]:
    """Return where the group may be seen: under its own name, or, in a container, as the root of what is mounted."""
    lines = of.read_text().splitlines() if of.is_file() else []
    names = [line.split(":", 2)[2] for line in lines if "cpu" in line.split(":")[1].split(",")]
    return [*(mount / name.lstrip("/") for name in names), mount]


def rungs_granted(wish: Wish) -> dict[str, str]:
    """Return each rung and what it gives or why it is refused; to be called in a process that may be spoilt by it."""
    found: dict[str, str] = {}
    for name in RUNGS:
        asked = Scheduling.ask(replace(wish, rungs=(name,)))
        asked.resume()
        found[name] = f"granted ({asked.had})" if not asked.refused else asked.refused[0].partition(": ")[2]
        _make_ordinary(asked._niceness)  # noqa: SLF001
    return found
