"""What the machine itself costs: late wake-ups of a thread that does next to nothing, above everything else.

``python benchmarks/machine_floor.py CORE SECONDS [--from-s TIME]`` pins itself to a core at the highest
real-time priority that it can have and prints one JSON object. Run beside a rig it says which of the rig's late ticks
nobody could have avoided: no process of the rig comes before it. It wakes every 5 ms, so that it costs the rig less
than a switch in a hundred; a wake-up that is over a millisecond late meets a stall with the same probability as the
deadline of a tick does. Each time it counts to a few hundred: how long that takes says how fast the core is just now,
whoever shares it unseen.

Each wake-up is a quarter of a millisecond later in the rig's millisecond than the last, so that all of it is met alike.
"""

from __future__ import annotations

import argparse
import gc
import json
import os
import subprocess
import sys
import time
from pathlib import Path

from trocar.services.diagnosis.core_sleepers import pin_above_all

PERIOD_NS, LATE_NS = 5_250_000, 1_000_000
_COUNTED = range(300)


def _count() -> int:
    """Return how long a fixed piece of arithmetic takes, in ns."""
    began_ns, total = time.perf_counter_ns(), 0
    for number in _COUNTED:
        total += number
    return time.perf_counter_ns() - began_ns


def _quantile(values: list[int], share: float) -> float:
    return float(sorted(values)[min(len(values) - 1, int(share * len(values)))])


def watch(core: int, seconds: float, from_s: float = 0.0) -> dict[str, float]:
    """Sleep on an absolute grid and return what share of the wake-ups was over a millisecond late, and how long a
    fixed piece of arithmetic took: median, and 99 % over median. The grid begins at `from_s` of the monotonic clock,
    if that is still to come."""
    if not pin_above_all(core):
        print("no real-time priority: this floor counts the rig's own work too", file=sys.stderr)
    gc.disable()
    late, worst_ns, ticks = 0, 0, round(seconds * 1e9 / PERIOD_NS)
    counted_ns: list[int] = []
    due_ns = max(time.monotonic_ns(), int(1e9 * from_s)) + PERIOD_NS
    for _ in range(ticks):
        time.sleep(max(0, due_ns - time.monotonic_ns()) * 1e-9)
        late_ns = time.monotonic_ns() - due_ns
        worst_ns = max(worst_ns, late_ns)
        late += late_ns > LATE_NS
        counted_ns.append(_count())
        due_ns += PERIOD_NS
    median_ns = _quantile(counted_ns, 0.5)
    return {
        "core": core,
        "lost_percent": 100.0 * late / ticks,
        "worst_us": worst_ns / 1e3,
        "arithmetic_us": median_ns / 1e3,
        "arithmetic_p99_over_median": _quantile(counted_ns, 0.99) / median_ns,
    }


class Floor:
    """Watchers of both cores for as long as a ``with`` block lasts, at most `seconds`.

    With `from_s`, a time of the monotonic clock, they are started before what they measure begins.
    """

    def __init__(self, seconds: float, from_s: float = 0.0) -> None:
        self._seconds, self._from_s = seconds, from_s
        self.cores: list[dict[str, float]] = []

    def __enter__(self) -> Floor:
        command = [sys.executable, str(Path(__file__))]
        self._watchers = [
            subprocess.Popen(
                [*command, str(core), str(self._seconds), "--from-s", str(self._from_s)],
                stdout=subprocess.PIPE,
            )
            for core in sorted(os.sched_getaffinity(0))[:2]
        ]
        return self

    def __exit__(self, *_: object) -> None:
        self.cores = [json.loads(watcher.communicate()[0]) for watcher in self._watchers]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("core", type=int)
    parser.add_argument("seconds", type=float)
    parser.add_argument("--from-s", type=float, default=0.0, help="time of the monotonic clock at which it begins")
    asked = parser.parse_args()
    print(json.dumps(watch(asked.core, asked.seconds, asked.from_s)))
