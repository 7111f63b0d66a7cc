"""The deadline loop: an absolute grid, no catching up by bursts, every tick accounted for."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import protocol.bodies as bodies
from services.runtime.histogram import LatencyHistogram


@dataclass(slots=True)
class Tick:
    """One turn of a loop."""

    index: int
    scheduled_ns: int
    started_ns: int


class LoopMeter:
    """Counts of a loop: lateness of the start, work, period, misses. A tick that never ran is a miss too."""

    def __init__(self, rate_hz: float) -> None:
        self.rate_hz = rate_hz
        self.period_ns = round(1e9 / rate_hz)
        self.ticks = 0
        self.misses = 0
        self.skipped = 0
        self.lateness = LatencyHistogram(self.period_ns)
        self.work = LatencyHistogram(self.period_ns)
        self.period = LatencyHistogram(self.period_ns)
        self._scheduled_ns = 0
        self._started_ns = 0

    def start(self, scheduled_ns: int, now_ns: int) -> None:
        """Count the start of a tick that was due at `scheduled_ns`."""
        self.lateness.record(now_ns - scheduled_ns)
        if self._started_ns:
            self.period.record(now_ns - self._started_ns)
        self._scheduled_ns = scheduled_ns
        self._started_ns = now_ns

    def finish(self, now_ns: int) -> None:
        """Count the end of the tick: finished after ``scheduled + period`` is a miss."""
        self.ticks += 1
        self.work.record(now_ns - self._started_ns)
        if now_ns - self._scheduled_ns > self.period_ns:
            self.misses += 1

    def skip(self, ticks: int) -> None:
        """Count ticks that never ran."""
        self.skipped += ticks
        self.misses += ticks

    def body(self) -> bodies.LoopReport:
        """Return the counts as they travel."""
        return bodies.LoopReport(
            rate_hz=self.rate_hz,
            ticks=self.ticks,
            misses=self.misses,
            skipped=self.skipped,
            lateness=self.lateness.body(),
            work=self.work.body(),
            period=self.period.body(),
        )


def sleep_until(deadline_ns: int) -> None:
    """Sleep to `deadline_ns` of the monotonic clock; returns at once if it has passed."""
    remaining = deadline_ns - time.monotonic_ns()
    if remaining > 0:
        time.sleep(remaining * 1e-9)


def ticks(
    meter: LoopMeter, stop: Callable[[], bool], wait_until: Callable[[int], None] = sleep_until
) -> Iterator[Tick]:
    """Yield a tick per period on an absolute grid until `stop` says so.

    The body of the ``for`` is the work of the tick. Work that overruns whole periods loses those ticks: they are
    counted as skipped and the loop goes on at the next point of the grid, never in a burst.

    Parameters
    ----------
    meter
        Rate and counts of the loop.
    stop
        Asked before every tick.
    wait_until
        What to do until the next point of the grid; it must return at that time (a bus may listen meanwhile).
    """
    index = 0
    scheduled = time.monotonic_ns() + meter.period_ns
    while not stop():
        wait_until(scheduled)
        now = time.monotonic_ns()
        meter.start(scheduled, now)
        yield Tick(index, scheduled, now)
        now = time.monotonic_ns()
        meter.finish(now)
        behind = max(0, now - scheduled) // meter.period_ns
        if behind > 0:
            meter.skip(behind)
        index += behind + 1
        scheduled += (behind + 1) * meter.period_ns
