"""What the machine itself costs: ticks of 1 ms that a thread loses which does nothing but sleep, above everything else.

``python benchmarks/machine_floor.py CORE SECONDS`` pins itself to a core at the highest real-time priority that it
can have and prints one JSON object. Run beside a rig it says which of the rig's late ticks nobody could have avoided:
no process of the rig comes before it.
"""

from __future__ import annotations

import gc
import json
import os
import subprocess
import sys
import time
from pathlib import Path

PERIOD_NS = 1_000_000
PRIORITY = 95


def watch(core: int, seconds: float) -> dict[str, float]:
    """Sleep on an absolute grid and return the share of ticks that began over a period late, and the worst, in us."""
    os.sched_setaffinity(0, {core})
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except PermissionError:
        print("no real-time priority: this floor counts the rig's own work too", file=sys.stderr)
    gc.disable()
    lost, worst_ns, ticks = 0, 0, round(seconds * 1e9 / PERIOD_NS)
    due_ns = time.monotonic_ns() + PERIOD_NS
    end_ns = due_ns + ticks * PERIOD_NS
    while due_ns < end_ns:
        time.sleep(max(0, due_ns - time.monotonic_ns()) * 1e-9)
        late_ns = time.monotonic_ns() - due_ns
        worst_ns = max(worst_ns, late_ns)
        lost += late_ns // PERIOD_NS
        due_ns += (1 + late_ns // PERIOD_NS) * PERIOD_NS
    return {"core": core, "lost_percent": 100.0 * lost / ticks, "worst_us": worst_ns / 1e3}


class Floor:
    """Watchers of both cores for as long as a ``with`` block lasts, at most `seconds`."""

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self.cores: list[dict[str, float]] = []

    def __enter__(self) -> Floor:
        command = [sys.executable, str(Path(__file__))]
        self._watchers = [
            subprocess.Popen([*command, str(core), str(self._seconds)], stdout=subprocess.PIPE)
            for core in sorted(os.sched_getaffinity(0))[:2]
        ]
        return self

    def __exit__(self, *_: object) -> None:
        self.cores = [json.loads(watcher.communicate()[0]) for watcher in self._watchers]


if __name__ == "__main__":
    print(json.dumps(watch(int(sys.argv[1]), float(sys.argv[2]))))
