"""What the threads of a running rig cost: context switches and processor time, as the kernel counts them."""

from __future__ import annotations

import os
import time
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from trocar.services.diagnosis.thread_usage import Counts, threads_of

_GONE = (FileNotFoundError, ProcessLookupError)
_ORDINARY = (os.SCHED_OTHER, os.SCHED_BATCH, os.SCHED_IDLE)


@dataclass(frozen=True)
class Thread:
    """`name` is that of its process in the rig, and what it does there."""

    name: str
    realtime: bool
    counts: Counts

    @property
    def switches(self) -> int:
        """Since it began."""
        return self.counts.woken + self.counts.preempted


def _name(tid: int, comm: str) -> str:
    """Return the process of the rig that a thread belongs to, and whether it is its loop or ZeroMQ's thread."""
    words = Path(f"/proc/{tid}/cmdline").read_bytes().decode().split("\0")
    ours = (word.removeprefix("trocar.").removeprefix("services.") for word in words if word.startswith("trocar."))
    module = next(ours, "supervisor")
    leads = f"Tgid:\t{tid}\n" in Path(f"/proc/{tid}/status").read_text()
    return f"{module}, {'loop' if leads else 'bus' if comm.startswith('ZMQbg/IO') else 'other'}"


def _all(root: int) -> dict[int, Thread]:
    found = {}
    for tid, counts in threads_of("rig", root, ()):
        try:
            realtime = os.sched_getscheduler(tid) & ~os.SCHED_RESET_ON_FORK not in _ORDINARY
            found[tid] = Thread(_name(tid, counts.thread), realtime, counts)
        except _GONE:
            continue
    return found


def watch(root: int, seconds: float) -> dict[str, Any]:
    """Return context switches per second of the rig under `root`, and what its threads take of a core, in percent.

    Of all together, of those in real time, and under ``threads`` one by one.
    """
    before, began_s = _all(root), time.monotonic()
    time.sleep(seconds)
    after, elapsed_s = _all(root), time.monotonic() - began_s
    both = [(before[tid], after[tid]) for tid in before.keys() & after.keys()]
    threads: defaultdict[str, dict[str, float]] = defaultdict(lambda: {"switches_per_s": 0.0, "percent": 0.0})
    switches = realtime = ordinary = 0.0
    for a, b in both:
        percent = 1e-7 * (b.counts.ran_ns - a.counts.ran_ns) / elapsed_s
        threads[a.name]["switches_per_s"] += (b.switches - a.switches) / elapsed_s
        threads[a.name]["percent"] += percent
        switches += (b.switches - a.switches) / elapsed_s
        realtime, ordinary = realtime + percent * b.realtime, ordinary + percent * (not b.realtime)
    return {
        "threads": dict(threads),
        "switches_per_s": switches,
        "realtime_percent": realtime,
        "all_percent": realtime + ordinary,
    }
