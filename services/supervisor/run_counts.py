"""What every process counted in a run, over each interval in which one rung of the quality ladder was in force.

What was lost before the governor acted says how slow the machine is, what was lost after it how much that helped.
Reports come a tenth of a second apart, so a change of rung is known as exactly.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import protocol.bodies as bodies
from services.supervisor.figures import Figures
from services.supervisor.figures import of as figures_of


class Tally:
    """What one process has counted since a moment, over its restarts; only its newest report is looked into, if asked.

    Args:
        before: Its last report before that moment, None where it had made none.
    """

    def __init__(self, before: bodies.Health | None) -> None:
        self._first = before
        self._newest: bodies.Health | None = before
        self._earlier = Figures(0.0)  # of incarnations before the newest

    def add(self, health: bodies.Health) -> None:
        """Take a report."""
        last = self._newest
        if last is not None and (health.pid != last.pid or health.uptime_s < last.uptime_s):
            self._earlier = self.counts()
            self._first = None
        self._newest = health

    def counts(self) -> Figures:
        """Return everything that was counted."""
        if self._newest is None:
            return self._earlier
        counted = figures_of(self._newest)
        return self._earlier + (counted if self._first is None else counted - figures_of(self._first))


@dataclass(slots=True)
class _Interval:
    """The time for which one rung was in force, and what every loop counted in it, once it is over."""

    level: int
    name: str
    start_s: float
    end_s: float
    loops: dict[str, dict[str, int]] = field(default_factory=dict)

    def close(self, counts: dict[str, Figures]) -> None:
        """Keep what is reported of it: histograms of every interval would be a megabyte each."""
        self.loops = {
            name: {"ticks": loop.ticks, "misses": loop.misses, "skipped": loop.skipped}
            for name, each in counts.items()
            if (loop := each.loop) is not None
        }

    def body(self, origin_s: float) -> dict[str, Any]:
        return {
            "level": self.level,
            "name": self.name,
            "start_s": round(self.start_s - origin_s, 3),
            "seconds": round(self.end_s - self.start_s, 3),
            "loops": self.loops,
        }


class RunCounts:
    """The counts of a run. A rung that is taken twice has two intervals."""

    def __init__(self) -> None:
        self._intervals: list[_Interval] = []
        self._tallies: dict[str, Tally] = {}  # of the newest interval
        self._earlier: dict[str, Figures] = {}  # of all others
        self._newest: dict[str, bodies.Health] = {}

    @property
    def has_begun(self) -> bool:
        """Whether anything is counted yet."""
        return bool(self._intervals)

    @property
    def seconds(self) -> float:
        """How long has been counted."""
        return self._intervals[-1].end_s - self._intervals[0].start_s if self._intervals else 0.0

    def begin(self, reports: Iterable[bodies.Health]) -> None:
        """Count from after these reports on; to be followed by `turn`."""
        self._newest = {health.process: health for health in reports}

    def turn(self, now_s: float, level: int, name: str) -> None:
        """Take note of the rung in force."""
        if self._intervals:
            self._intervals[-1].end_s = now_s
        if not self._intervals or self._intervals[-1].level != level:
            self._earlier = self.totals()
            self._close()
            self._tallies = {process: Tally(health) for process, health in self._newest.items()}
            self._intervals.append(_Interval(level, name, now_s, now_s))

    def _close(self) -> None:
        if self._intervals:
            self._intervals[-1].close({name: tally.counts() for name, tally in self._tallies.items()})

    def add(self, health: bodies.Health) -> None:
        """Take a process' report."""
        self._newest[health.process] = health
        if self._intervals:
            self._tallies.setdefault(health.process, Tally(None)).add(health)

    def totals(self) -> dict[str, Figures]:
        """Return what each process counted in the whole run."""
        sums = dict(self._earlier)
        for name, tally in self._tallies.items():
            sums[name] = sums.get(name, Figures(0.0)) + tally.counts()
        return sums

    def rungs(self) -> list[dict[str, Any]]:
        """Return the intervals as they are reported, from the start of the first one on."""
        self._close()
        return [interval.body(self._intervals[0].start_s) for interval in self._intervals]
