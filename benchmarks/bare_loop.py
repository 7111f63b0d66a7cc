"""The smallest loop of 1 kHz: ``python benchmarks/bare_loop.py CORE SECONDS WORK_US``.

Pins itself to a core with the priority of the rig's loops and does in every millisecond a piece of arithmetic that
took WORK_US on the idle machine. Says "ready" on standard output once it knows how much that is, and begins when a line
comes back; prints the percentage of its ticks that were over late or never began. Beside a load it says what any
program with as much to do would lose.
"""

from __future__ import annotations

import argparse
import gc
import os
import sys
import time

PERIOD_NS = 1_000_000
PRIORITY = 60


def work(count: int) -> int:
    """Do `count` pieces of arithmetic."""
    total = 0
    for number in range(count):
        total += number
    return total


def pieces_of(work_us: float) -> int:
    """Return how many pieces take so long: of a hundred tries the median."""
    tries, count = [], 2000
    for _ in range(100):
        began_ns = time.perf_counter_ns()
        work(count)
        tries.append(time.perf_counter_ns() - began_ns)
    return max(1, round(count * 1e3 * work_us / sorted(tries)[50]))


def lost_percent(seconds: float, count: int) -> float:
    """Run for so long and return what share of the ticks was late or never ran."""
    ticks, lost = round(seconds * 1e9 / PERIOD_NS), 0
    due_ns, end_ns = time.monotonic_ns(), time.monotonic_ns() + ticks * PERIOD_NS
    while due_ns < end_ns:
        time.sleep(max(0, due_ns - time.monotonic_ns()) * 1e-9)
        work(count)
        late_ns = time.monotonic_ns() - due_ns
        passed = late_ns // PERIOD_NS
        lost += passed
        due_ns += PERIOD_NS * max(1, passed)
    return 100.0 * lost / ticks


def main() -> None:
    """Run it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, kind in (("core", int), ("seconds", float), ("work_us", float)):
        parser.add_argument(name, type=kind)
    asked = parser.parse_args()
    os.sched_setaffinity(0, {asked.core})
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except PermissionError as error:
        raise SystemExit(f"bare_loop: {error.strerror}: a real-time priority is needed") from None
    gc.disable()
    count = pieces_of(asked.work_us)
    print("ready", flush=True)
    sys.stdin.readline()
    print(lost_percent(asked.seconds, count))


if __name__ == "__main__":
    main()
