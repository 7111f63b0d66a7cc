"""Real-time set-up of a process: what was asked for, what was had. To be called before the ZeroMQ context is made.

The order matters: threads inherit scheduling when they start, so a context made first keeps its I/O thread in the
ordinary class and the loaded p99 of a round trip goes from 86 to 1987 us.
"""

from __future__ import annotations

import ctypes
import gc
import os
from dataclasses import dataclass
from pathlib import Path

import protocol.bodies as bodies

_PR_SET_TIMERSLACK = 29
_MCL_CURRENT, _MCL_FUTURE = 1, 2
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3
_LARGEST_MMAP_THRESHOLD = 32 << 20
_libc = ctypes.CDLL(None, use_errno=True)


@dataclass(frozen=True, slots=True)
class Fact:
    """One property: asked for, and had."""

    name: str
    asked: str
    had: str
    ok: bool

    def body(self) -> bodies.RealtimeFact:
        """Return the fact as it travels."""
        return bodies.RealtimeFact(name=self.name, asked=self.asked[:128], had=self.had[:256], ok=self.ok)


def set_up(core: int | None, priority: int | None, nice: int | None = None) -> list[Fact]:
    """Pin the process, raise its scheduling class, tighten its timers; return what was had.

    Parameters
    ----------
    core
        Processor to run on, None for any.
    priority
        SCHED_FIFO priority 1..89, None for the ordinary class.
    nice
        Niceness of an ordinary process.
    """
    facts = [_pin(core), _schedule(priority, nice), _timer_slack()]
    if priority is not None:
        facts += [keep_heap(), _lock_memory()]
    return facts


def keep_heap() -> Fact:
    """Let the heap keep what is given back to it: memory that a tick frees is there for the next tick.

    Locked memory is populated when it is mapped. A heap that is trimmed and grown again in every call (a packer's
    buffer of 256 kB at an unlucky place, huge pages) costs a millisecond a call, for as long as the process lives.
    """
    ok = _libc.mallopt(_M_TRIM_THRESHOLD, 2**31 - 1) and _libc.mallopt(_M_MMAP_THRESHOLD, _LARGEST_MMAP_THRESHOLD)
    return Fact("heap", "never trimmed", "never trimmed" if ok else "trimmed: mallopt refused", bool(ok))


def relax() -> None:
    """Put the calling thread, and it alone, into the ordinary class: what it does before its loop may wait."""
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def resume(priority: int, *, alone: bool = False) -> None:
    """Put the calling thread back into SCHED_FIFO, which `set_up` was granted.

    With `alone`, what it starts from now on is ordinary: for one that starts processes.
    """
    policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK if alone else os.SCHED_FIFO
    os.sched_setscheduler(0, policy, os.sched_param(priority))


def freeze_garbage_collector() -> Fact:
    """Freeze what is alive and switch the collector off: to be called when a loop is warm and about to run."""
    gc.collect()
    gc.freeze()
    gc.disable()
    return Fact("garbage collector", "off, start-up objects frozen", f"off, {gc.get_freeze_count()} frozen", True)


def read_back() -> Fact:
    """Return the scheduling class of every thread of this process, as the kernel has it now."""
    threads = sorted(int(task.name) for task in Path("/proc/self/task").iterdir())
    names = {os.SCHED_FIFO: "FIFO", os.SCHED_OTHER: "OTHER", os.SCHED_RR: "RR"}
    policies = [os.sched_getscheduler(thread) & ~os.SCHED_RESET_ON_FORK for thread in threads]
    had = [f"{names.get(p, '?')} {os.sched_getparam(t).sched_priority}" for p, t in zip(policies, threads, strict=True)]
    return Fact("threads", "one class for all", ", ".join(had), len(set(policies)) == 1)


def _pin(core: int | None) -> Fact:
    if core is None:
        return Fact("core", "any", f"{sorted(os.sched_getaffinity(0))}", True)
    allowed = os.sched_getaffinity(0)
    if core not in allowed:
        return Fact("core", str(core), f"this process may use {sorted(allowed)} only", False)
    os.sched_setaffinity(0, {core})
    return Fact("core", str(core), f"{sorted(os.sched_getaffinity(0))}", True)


def _schedule(priority: int | None, nice: int | None) -> Fact:
    if priority is None:
        if nice:
            os.setpriority(os.PRIO_PROCESS, 0, nice)
        return Fact("scheduling", f"OTHER, nice {nice or 0}", f"OTHER, nice {os.nice(0)}", True)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except PermissionError:
        had = "OTHER: the system refuses SCHED_FIFO (needs CAP_SYS_NICE or an rtprio limit; `trocar doctor` says more)"
        return Fact("scheduling", f"FIFO {priority}", had, False)
    return Fact("scheduling", f"FIFO {priority}", f"FIFO {os.sched_getparam(0).sched_priority}", True)


def _timer_slack() -> Fact:
    ok = _libc.prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0) == 0
    return Fact("timer slack", "1 ns", "1 ns" if ok else os.strerror(ctypes.get_errno()), ok)


def _lock_memory() -> Fact:
    # MCL_FUTURE under a small memlock limit makes later allocations fail, so it is asked for only where there is room.
    import resource

    limit = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0]
    asked = "all pages locked"
    if limit != resource.RLIM_INFINITY and os.geteuid() != 0 and limit < 1 << 30:
        return Fact("memory", asked, f"not locked: the memlock limit is {limit >> 20} MiB", False)
    ok = _libc.mlockall(_MCL_CURRENT | _MCL_FUTURE) == 0
    return Fact("memory", asked, "locked" if ok else f"not locked: {os.strerror(ctypes.get_errno())}", ok)
