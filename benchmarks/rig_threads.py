"""What the threads of a running rig cost: context switches and processor time, as the kernel counts them."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

_GONE = (FileNotFoundError, ProcessLookupError)
_PARENT, _PRIORITY = 1, 37  # places in /proc/PID/stat after the name


@dataclass(frozen=True)
class ThreadCounts:
    """Of one thread since it began; `name` is that of its process in the rig, and what it does there."""

    name: str
    switches: int
    busy_ns: int
    realtime: bool


def _stat(folder: Path) -> list[str]:
    return (folder / "stat").read_text().rpartition(")")[2].split()


def _name(task: Path) -> str:
    """Return the process of the rig that a thread belongs to, and whether it is its loop or ZeroMQ's thread."""
    process = task.parents[1]
    words = (process / "cmdline").read_bytes().decode().split("\0")
    module = next((word.removeprefix("services.") for word in words if word.startswith("services.")), "supervisor")
    comm = (task / "comm").read_text().strip()
    kind = "loop" if task.name == process.name else "bus" if comm.startswith("ZMQbg/IO") else "other"
    return f"{module}, {kind}"


def _counts(task: Path) -> ThreadCounts:
    status = (task / "status").read_text()
    switches = sum(int(line.split()[1]) for line in status.splitlines() if "ctxt_switches" in line)
    return ThreadCounts(
        _name(task), switches, int((task / "schedstat").read_text().split()[0]), int(_stat(task)[_PRIORITY]) > 0
    )


def _family(root: int) -> Iterator[int]:
    """Yield process `root` and all that it has started, and they."""
    children: dict[int, list[int]] = {}
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            try:
                children.setdefault(int(_stat(folder)[_PARENT]), []).append(int(folder.name))
            except _GONE:
                continue
    waiting = [root]
    while waiting:
        pid = waiting.pop()
        yield pid
        waiting += children.get(pid, [])


def _all(root: int) -> dict[Path, ThreadCounts]:
    found = {}
    for pid in _family(root):
        try:
            for task in Path(f"/proc/{pid}/task").iterdir():
                found[task] = _counts(task)
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
    both = [(before[task], after[task]) for task in before.keys() & after.keys()]
    busy = [(b.busy_ns - a.busy_ns, b.realtime) for a, b in both]
    threads: defaultdict[str, dict[str, float]] = defaultdict(lambda: {"switches_per_s": 0.0, "percent": 0.0})
    for a, b in both:
        threads[a.name]["switches_per_s"] += (b.switches - a.switches) / elapsed_s
        threads[a.name]["percent"] += 1e-7 * (b.busy_ns - a.busy_ns) / elapsed_s
    return {
        "threads": dict(threads),
        "switches_per_s": sum(b.switches - a.switches for a, b in both) / elapsed_s,
        "realtime_percent": 1e-7 * sum(ns for ns, realtime in busy if realtime) / elapsed_s,
        "all_percent": 1e-7 * sum(ns for ns, _ in busy) / elapsed_s,
    }
