"""What a process reports of itself, ten times a second, from inside its own loop: no second thread."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from operator import add

import protocol.bodies as bodies
from services.runtime.bus import Bus
from services.runtime.histogram import LatencyHistogram
from services.runtime.loop import LoopMeter
from services.runtime.realtime import Fact

_PERIOD_NS = 100_000_000


@dataclass(slots=True)
class LatencyPath:
    """Latency of a named path, and of how many samples an answer came in time."""

    latency: LatencyHistogram
    answered: int = 0
    asked: int = 0


@dataclass(slots=True)
class _Row:
    """Costs of stages that are timed together."""

    sum_ns: list[int]
    max_ns: list[int]
    count: int = 0


class StageClock:
    """Mean and maximum cost of named stages since the last report."""

    def __init__(self) -> None:
        self._sums: dict[str, list[float]] = {}
        self._rows: dict[tuple[str, ...], _Row] = {}

    def add(self, name: str, duration_ns: float) -> None:
        """Count one run of a stage."""
        cell = self._sums.get(name)
        if cell is None:
            self._sums[name] = [1.0, duration_ns, duration_ns]
        else:
            cell[0] += 1.0
            cell[1] += duration_ns
            cell[2] = max(cell[2], duration_ns)

    def add_all(self, names: tuple[str, ...], durations_ns: list[int]) -> None:
        """Count one run each of stages that are timed together: for little more than one of them."""
        row = self._rows.get(names)
        if row is None:
            row = self._rows[names] = _Row([0] * len(names), [0] * len(names))
        row.count += 1
        row.sum_ns = list(map(add, row.sum_ns, durations_ns))
        row.max_ns = list(map(max, row.max_ns, durations_ns))

    def take(self) -> tuple[bodies.StageCost, ...]:
        """Return the figures and begin anew."""
        sums = dict(self._sums)
        for names, row in self._rows.items():
            cells = zip(row.sum_ns, row.max_ns, strict=True)
            sums.update({name: [row.count, total, top] for name, (total, top) in zip(names, cells, strict=True)})
        self._sums.clear()
        self._rows.clear()
        return tuple(
            bodies.StageCost(name=name, mean_us=total / count / 1e3, max_us=top / 1e3)
            for name, (count, total, top) in sums.items()
        )


class HealthReporter:
    """Collects a process' figures and sends them when they are due.

    Attributes
    ----------
    gauges
        Figures that the process writes when they change.
    counts
        Returns further ones: asked when a report is made, not in every tick.
    """

    def __init__(self, process: str, bus: Bus, meter: LoopMeter | None = None) -> None:
        self.process = process
        self.state = "starting"
        self.detail = ""
        self.meter = meter
        self.paths: dict[str, LatencyPath] = {}
        self.stages = StageClock()
        self.gauges: dict[str, float] = {}
        self.counts: Callable[[], Mapping[str, float]] = dict
        self.realtime: list[Fact] = []
        self.quality_level = 0
        self._bus = bus
        self._started_ns = time.monotonic_ns()
        self._due_ns = 0

    def path(self, name: str, deadline_ns: int) -> LatencyPath:
        """Return (and from now on report) a path whose latency is judged against `deadline_ns`."""
        return self.paths.setdefault(name, LatencyPath(LatencyHistogram(deadline_ns)))

    def change(self, state: str, detail: str = "") -> None:
        """Take another state and say so at once."""
        if (state, detail) != (self.state, self.detail):
            self.state, self.detail = state, detail
            self._due_ns = 0
            self.send_if_due()

    def is_due(self) -> bool:
        """Return whether 100 ms have passed since the last report."""
        return time.monotonic_ns() >= self._due_ns

    def send_if_due(self) -> None:
        """Send a report if it is due: a tenth of a millisecond, best spent where nobody waits for this process.

        What was published before leaves first.
        """
        if not self.is_due():
            return
        os.sched_yield()
        now = time.monotonic_ns()
        self._due_ns = now + _PERIOD_NS
        self._bus.publish(f"{self.process}.health", self._body(now))

    def _body(self, now_ns: int) -> bodies.Health:
        return bodies.Health(
            process=self.process,
            pid=os.getpid(),
            state=self.state,
            detail=self.detail[:512],
            uptime_s=(now_ns - self._started_ns) * 1e-9,
            loop=self.meter.body() if self.meter else None,
            topics=self._bus.reports(),
            paths=tuple(
                bodies.PathLatency(name=name, latency=path.latency.body(), answered=path.answered, asked=path.asked)
                for name, path in self.paths.items()
            ),
            stages=self.stages.take(),
            realtime=tuple(fact.body() for fact in self.realtime),
            quality_level=self.quality_level,
            gauges={**self.gauges, **self.counts(), "refused_readers": float(self._bus.refused_readers)},
        )
