"""A core at a part of its speed: ``python benchmarks/slow_core.py CORE SECONDS SHARE``.

Pins itself to a core and computes for a share of every 0.487 ms at a real-time priority above everything of the
rig, so that whatever else runs there gets the rest: a machine that is slower, not one that is busy, which real-time
threads would not notice. Says on standard output when it has begun.

The period is no part of the rig's millisecond. At half a millisecond the load met every tick at the phase at which it
happened to begin: the same work of the gateway took 50 us in one run and 300 in the next.
"""

from __future__ import annotations

import argparse
import gc
import os
import time

PERIOD_NS = 487_000
PRIORITY = 94


def burn(core: int, seconds: float, share: float) -> None:
    """Take the share of the core for so long.

    Raises PermissionError: the system refuses a real-time priority; without one the rig would simply go first.
    """
    os.sched_setaffinity(0, {core})
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    _burn(seconds, round(share * PERIOD_NS))


def _burn(seconds: float, busy_ns: int) -> None:
    gc.disable()
    print("burning", flush=True)
    began_ns = due_ns = time.monotonic_ns()
    while due_ns < began_ns + seconds * 1e9:
        until_ns = due_ns + busy_ns
        while time.monotonic_ns() < until_ns:
            pass
        due_ns += PERIOD_NS
        time.sleep(max(0, due_ns - time.monotonic_ns()) * 1e-9)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, kind in (("core", int), ("seconds", float), ("share", float)):
        parser.add_argument(name, type=kind)
    given = parser.parse_args()
    try:
        burn(given.core, given.seconds, given.share)
    except OSError as error:
        raise SystemExit(f"slow_core: {error.strerror}: a real-time class is needed") from None
