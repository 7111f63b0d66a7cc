"""Counts of every process in a run, over each interval of one quality level.

The losses before the governor acted show how slow the machine is, those after it how much that helped. Reports are a
tenth of a second apart, so the time of a change of level is known to that accuracy.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import trocar.protocol.bodies as bodies
from trocar.services.supervisor.judge.figures import Figures
from trocar.services.supervisor.judge.figures import of as figures_of


class Tally:
    """Counts of one process since a time, over its restarts, evaluated only on request.

    Args:
        before: Its last report before that time, None without one.
    """

    def __init__(self, before: bodies.Health | None) -> None:
        self._first = before
        self._newest: bodies.Health | None = before
        self._earlier = Figures(0.0)  # of earlier incarnations

    def add(self, health: bodies.Health) -> None:
        """Add a report."""
        last = self._newest
        if last is not None and (health.pid != last.pid or health.uptime_s < last.uptime_s):
            self._earlier = self.counts()
            self._first = None
        self._newest = health

    def counts(self) -> Figures:
        """Return the total counts."""
        if self._newest is None:
            return self._earlier
        counted = figures_of(self._newest)
        return self._earlier + (counted if self._first is None else counted - figures_of(self._first))


@dataclass(slots=True)
class _Interval:
    """An interval of one quality level, with the counts of every loop once it is over."""

    level: int
    name: str
    start_s: float
    end_s: float
    loops: dict[str, dict[str, int]] = field(default_factory=dict)

    def close(self, counts: dict[str, Figures]) -> None:
        """Store only the reported counts, as the histograms of an interval are a megabyte."""
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
    """The counts of a run; a level that is taken twice has two intervals."""

    def __init__(self) -> None:
        self._intervals: list[_Interval] = []
        self._tallies: dict[str, Tally] = {}  # of the present interval
        self._earlier: dict[str, Figures] = {}  # of earlier ones
        self._newest: dict[str, bodies.Health] = {}

    @property
    def has_begun(self) -> bool:
        """Whether counting has begun."""
        return bool(self._intervals)

    @property
    def seconds(self) -> float:
        """Duration of counting."""
        return self._intervals[-1].end_s - self._intervals[0].start_s if self._intervals else 0.0

    def begin(self, reports: Iterable[bodies.Health]) -> None:
        """Start counting after these reports; call `turn` next."""
        self._newest = {health.process: health for health in reports}

    def turn(self, now_s: float, level: int, name: str) -> None:
        """Record the present quality level."""
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
        """Add a process' report."""
        self._newest[health.process] = health
        if self._intervals:
            self._tallies.setdefault(health.process, Tally(None)).add(health)

    def totals(self) -> dict[str, Figures]:
        """Return the counts of each process in the whole run."""
        sums = dict(self._earlier)
        for name, tally in self._tallies.items():
            sums[name] = sums.get(name, Figures(0.0)) + tally.counts()
        return sums

    def rungs(self) -> list[dict[str, Any]]:
        """Return the intervals for the report, with times from the start of the first."""
        self._close()
        return [interval.body(self._intervals[0].start_s) for interval in self._intervals]
