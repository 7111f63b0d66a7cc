"""One sleeping thread a core, while somebody looks: ``python -m trocar.services.diagnosis.core_sleepers DIRECTORY``.

The thread sleeps to a grid, with a priority above every process of the rig: when it wakes late, no process of the rig
could have run. It writes due and wake-up times into a flight ring (`floor0`, `floor1`, ...), so that misses of the rig
and of the machine are on one time line. The time for which it was runnable and waited, by the kernel's count, was used
by another process; only the rest is the machine's. Without SCHED_FIFO that time is subtracted from the wake-up.

A wake-up takes 75 us of its core, in every tenth tick. The process ends with its parent, and imports neither numpy nor
the bus.
"""

from __future__ import annotations

import trocar.services.start.entry  # noqa: F401  first: the environment of a process

# isort: split
import gc
import os
import resource
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from trocar.services.runtime.measures.flight import SUFFIX, FlightRing

#: Rate of wake-ups: measured, each takes about 75 us, so that they take 0.8 % of a core.
RATE_HZ = 100.0
#: Above all priorities that a rig file can set, as it measures what delays even these.
PRIORITY = 95
NAME = "floor"


@contextmanager
def watching(directory: Path) -> Iterator[None]:
    """Have every core watched meanwhile, in rings in `directory`, which are removed afterwards."""
    watcher = subprocess.Popen([sys.executable, "-m", __name__, str(directory)], stdin=subprocess.DEVNULL)
    try:
        yield
    finally:
        watcher.kill()
        watcher.wait()
        for ring in directory.glob(f"{NAME}[0-9]*{SUFFIX}"):
            ring.unlink(missing_ok=True)


def pin_above_all(core: int) -> bool:
    """Pin the calling thread to `core` with the highest possible priority; return whether it has one."""
    os.sched_setaffinity(0, {core})
    limit = resource.getrlimit(resource.RLIMIT_RTPRIO)[0]
    for priority in (PRIORITY, min(PRIORITY, limit)):
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
        except OSError:  # try the limit of an ordinary user, then none
            continue
        return True
    return False


class Waiting:
    """Time for which the calling thread was runnable and waited for its core, by the kernel."""

    def __init__(self) -> None:
        path = Path(f"/proc/self/task/{threading.get_native_id()}/schedstat")
        self._file = os.open(path, os.O_RDONLY) if path.is_file() else None
        self._seen_ns = self._counted()

    def _counted(self) -> int:
        return 0 if self._file is None else int(os.pread(self._file, 128, 0).split()[1])

    def since_ns(self) -> int:
        """Return the increase since the last call, 0 if the kernel does not count it."""
        before, self._seen_ns = self._seen_ns, self._counted()
        return self._seen_ns - before


def watch(core: int, ring: FlightRing, parent: int) -> None:
    """Sleep and record wake-ups on `core`, until the parent has ended."""
    is_above_all, waiting = pin_above_all(core), Waiting()
    period_ns = round(1e9 / ring.rate_hz)
    due_ns = time.monotonic_ns() + period_ns + core * period_ns // (os.cpu_count() or 1)  # staggers the cores
    tick = 0
    while os.getppid() == parent:
        time.sleep(max(0, due_ns - time.monotonic_ns()) * 1e-9)
        now_ns = time.monotonic_ns()
        waited_ns = 0 if is_above_all else waiting.since_ns()
        ring.write(tick, due_ns, max(due_ns, now_ns - waited_ns), now_ns, 0, ())
        behind = max(0, now_ns - due_ns) // period_ns
        tick += 1 + behind
        due_ns += (1 + behind) * period_ns


def main(directory: Path) -> None:
    """Watch every core that this process may use."""
    parent = os.getppid()
    threads = []
    for core in sorted(os.sched_getaffinity(0)):
        os.sched_setaffinity(0, {core})  # for the ring's header
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
