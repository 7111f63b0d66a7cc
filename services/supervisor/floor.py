"""What the machine itself costs: ``python -m services.supervisor.floor DIRECTORY``, started by the page's process.

A thread a core does nothing but sleep to a grid, above every process of the rig: where it wakes late, nobody of the
rig could have run. It writes when it was due and when it woke into a flight ring (`floor0`, `floor1`, ...), so that
misses of the rig and of the machine lie on one time line. It ends with whoever started it.
"""

from __future__ import annotations

import gc
import os
import resource
import sys
import threading
import time
from pathlib import Path

from services.runtime.flight import SUFFIX, FlightRing

#: A wake-up of each costs about 20 us of its core: this often, 0.2 % of it.
RATE_HZ = 100.0
#: Above all that a rig file can ask for.
PRIORITY = 95
NAME = "floor"


def watch(core: int, ring: FlightRing, parent: int) -> None:
    """Sleep and note, on `core`, until the parent is another."""
    os.sched_setaffinity(0, {core})
    limit = resource.getrlimit(resource.RLIMIT_RTPRIO)[0]
    for priority in (PRIORITY, min(PRIORITY, limit)):
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
            break
        except (PermissionError, OSError):  # the next: what the limit of an ordinary user allows, or none
            continue
    period_ns = round(1e9 / ring.rate_hz)
    due_ns = time.monotonic_ns() + period_ns + core * period_ns // (os.cpu_count() or 1)  # not both at once
    tick = 0
    while os.getppid() == parent:
        time.sleep(max(0, due_ns - time.monotonic_ns()) * 1e-9)
        now_ns = time.monotonic_ns()
        ring.write(tick, due_ns, now_ns, now_ns, 0, ())
        behind = max(0, now_ns - due_ns) // period_ns
        tick += 1 + behind
        due_ns += (1 + behind) * period_ns


def main(directory: Path) -> None:
    """Watch every core that this process may use."""
    parent = os.getppid()
    threads = []
    for core in sorted(os.sched_getaffinity(0)):
        os.sched_setaffinity(0, {core})  # which the ring's header says
        ring = FlightRing(RATE_HZ)
        ring.share(directory / f"{NAME}{core}{SUFFIX}")
        threads.append(threading.Thread(target=watch, args=(core, ring, parent), daemon=True))
    gc.collect()
    gc.disable()
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
