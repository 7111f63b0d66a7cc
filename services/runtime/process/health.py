"""Reports of a process on itself, ten times a second, from its own loop without a second thread."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Generator, Iterator, Mapping
from dataclasses import dataclass

import trocar.protocol.bodies as bodies
from trocar.protocol.topics import HEALTH_S
from trocar.services.runtime.bus.bus import Bus
from trocar.services.runtime.config.rig import PATH_OWNERS
from trocar.services.runtime.loop.loop import LoopMeter
from trocar.services.runtime.measures.histogram import LatencyHistogram
from trocar.services.runtime.measures.stage_times import StageTimes
from trocar.services.runtime.realtime.realtime import Fact
from trocar.services.runtime.realtime.scheduling import step_aside

_PERIOD_NS = round(1e9 * HEALTH_S)
#: Shortest time between reports that are urgent: a flood without end costs a tenth more of them.
_URGENT_EVERY_NS = 1_000_000_000
#: Prefix of gauges of flooded topics, with the number of frames beyond the rate.
FLOOD = "flood."
_DONE = object()


@dataclass(slots=True)
class LatencyPath:
    """Latency of a named path, and the number of samples with an answer in time."""

    latency: LatencyHistogram
    answered: int = 0
    asked: int = 0


class HealthReporter:
    """Collects a process' figures and sends them when due.

    Attributes:
        gauges: Figures that the process writes on changes.
        counts: Returns further ones, called once per report.
    """

    def __init__(self, process: str, bus: Bus, meter: LoopMeter | None = None) -> None:
        self.process = process
        self.state = "starting"
        self.detail = ""
        self.meter = meter
        self.paths: dict[str, LatencyPath] = {}
        self._stages: StageTimes | None = None
        self._pieces: Iterator[None] | None = None  # parts of the report in progress
        self.gauges: dict[str, float] = {}
        self.counts: Callable[[], Mapping[str, float]] = dict
        self.realtime: list[Fact] = []
        self.quality_level = 0
        self._bus = bus
        self._started_ns = time.monotonic_ns()
        self._due_ns = 0
        self._urgent_ns = -_URGENT_EVERY_NS
        bus.on_flood = self._make_urgent

    def path(self, name: str, deadline_ns: int) -> LatencyPath:
        """Return a path of `PATH_OWNERS` with the deadline `deadline_ns`, which is reported from now on."""
        if name not in PATH_OWNERS:
            raise KeyError(f"{name!r} is no path of PATH_OWNERS: a rig file could not say what it must keep")
        return self.paths.setdefault(name, LatencyPath(LatencyHistogram(deadline_ns)))

    def change(self, state: str, detail: str = "") -> None:
        """Change the state and report it at once."""
        if (state, detail) != (self.state, self.detail):
            self.state, self.detail = state, detail
            self._due_ns = 0
            self.send_if_due()

    def _make_urgent(self) -> None:
        now_ns = time.monotonic_ns()
        if now_ns - self._urgent_ns >= _URGENT_EVERY_NS:
            self._urgent_ns, self._due_ns = now_ns, 0

    def is_due(self) -> bool:
        """Return whether 100 ms have passed since the last report."""
        return time.monotonic_ns() >= self._due_ns

    def do_a_piece(self) -> bool:
        """Do the next part of a due report; return whether there was one. The last part sends it.

        This is for loops without time for a whole report between two ticks: it takes a third of a millisecond with cold
        caches, a part a fifth of that.
        """
        if self._pieces is None:
            if not self.is_due():
                return False
            self._pieces = self._make()
        if next(self._pieces, _DONE) is _DONE:
            self._pieces = None
        return True

    def send_if_due(self) -> None:
        """Send a report if it is due, or finish one; call this while no other process waits.

        Frames published before are sent first.
        """
        while self.is_due():
            self.do_a_piece()

    def _make(self) -> Iterator[None]:
        """Make and send a report in parts of about equal duration."""
        began_ns = time.monotonic_ns()
        health = yield from self._compose()
        step_aside()
        self._due_ns = began_ns + _PERIOD_NS
        self._bus.publish(f"{self.process}.health", health)

    def _compose(self) -> Generator[None, None, bodies.Health]:
        stages = self._stage_costs()
        yield
        counted_ns = time.monotonic_ns()  # time of the counts, for rates
        loop = self.meter.body() if self.meter else None
        yield
        topics = self._bus.reports()
        yield
        paths = tuple(
            bodies.PathLatency(name=name, latency=path.latency.body(), answered=path.answered, asked=path.asked)
            for name, path in self.paths.items()
        )
        counts = self.counts()
        yield
        return bodies.Health(
            process=self.process,
            pid=os.getpid(),
            state=self.state,
            detail=self.detail[:512],
            uptime_s=(counted_ns - self._started_ns) * 1e-9,
            loop=loop,
            topics=topics,
            paths=paths,
            stages=stages,
            realtime=tuple(fact.body() for fact in self.realtime),
            quality_level=self.quality_level,
            gauges={
                **self.gauges,
                **counts,
                **self._bus.gauges(),
                **{f"{FLOOD}{topic}": float(frames) for topic, frames in self._bus.floods().items()},
            },
        )

    def _stage_costs(self) -> tuple[bodies.StageCost, ...]:
        if self.meter is None:
            return ()
        if self._stages is None:
            self._stages = StageTimes(self.meter.flight)
        return self._stages.take_costs()
