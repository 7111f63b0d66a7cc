"""Counts of processes, as differences: health bodies are cumulative, so a window is newest minus oldest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

import trocar.protocol.bodies as bodies
from trocar.services.runtime.measures import stage_times
from trocar.services.runtime.measures.histogram import BUCKETS, PER_OCTAVE, Quantiles, edges_ns, late, quantiles_us

#: Limit of a bucket's count, so that sums over all buckets fit into 64 bits, whatever a peer sends.
_COUNT_MAX = 1 << 50


@dataclass(frozen=True, slots=True)
class Latencies:
    """Bucket counts of durations; `max_ns`, the largest since the process began, is an upper bound of the maximum."""

    deadline_ns: int
    counts: NDArray[np.int64]
    sum_ns: int = 0
    max_ns: int = 0

    @classmethod
    def of(cls, body: bodies.Histogram) -> Latencies:
        """Return the counts of a histogram body; one of another size, from an unknown peer, counts as empty."""
        counts = body.counts.view()
        if len(counts) != BUCKETS:
            return cls(body.deadline_ns, np.zeros(BUCKETS, np.int64))
        return cls(body.deadline_ns, np.clip(counts, 0, _COUNT_MAX), body.sum_ns, max(0, body.max_ns))

    @property
    def total(self) -> int:
        """Number of durations."""
        return int(self.counts.sum())

    @property
    def late(self) -> int:
        """Number of durations above the deadline."""
        return late(self.counts)

    def coarse(self) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Return upper edges in microseconds and counts of two buckets per doubling; the last bucket is open.

        The deadline is an edge, so the number of late durations is exact.
        """
        chosen = np.arange(0, BUCKETS - 1, PER_OCTAVE // 2)
        cumulative = np.cumsum(self.counts)
        counts = np.diff(cumulative[chosen], prepend=0, append=cumulative[-1])
        return edges_ns(self.deadline_ns)[chosen] / 1e3, counts

    def quantiles(self) -> Quantiles:
        """Return p50, p99, p99.9 and maximum in microseconds."""
        return quantiles_us(self.counts, self.deadline_ns, float(self.max_ns) if self.max_ns else np.inf)

    def __sub__(self, older: Latencies) -> Latencies:
        if older.deadline_ns != self.deadline_ns:  # other edges: not comparable
            return self
        # Counts only grow; a fallen one is an error of the peer.
        counts = np.maximum(self.counts - older.counts, 0)
        return Latencies(self.deadline_ns, counts, self.sum_ns - older.sum_ns, self.max_ns)

    def __add__(self, other: Latencies) -> Latencies:
        counts, total_ns = self.counts + other.counts, self.sum_ns + other.sum_ns
        return Latencies(self.deadline_ns, counts, total_ns, max(self.max_ns, other.max_ns))


#: Placeholder for irrelevant durations.
_NOTHING = Latencies(0, np.zeros(0, np.int64))


@dataclass(frozen=True, slots=True)
class Loop:
    """Counts of a deadline loop."""

    target_hz: float
    ticks: int
    misses: int
    skipped: int
    lateness: Latencies
    work: Latencies
    beyond_work: int = 0

    @classmethod
    def of(cls, body: bodies.LoopReport) -> Loop:
        """Return the counts of a loop body."""
        return cls(
            body.rate_hz, body.ticks, body.misses, body.skipped,
            Latencies.of(body.lateness), Latencies.of(body.work), body.beyond_work,
        )  # fmt: skip

    @property
    def miss_ratio(self) -> float:
        """Share of due ticks that finished late or never ran; NaN where none was due."""
        due = self.ticks + self.skipped
        return self.misses / due if due else float("nan")

    def __sub__(self, older: Loop) -> Loop:
        return Loop(
            self.target_hz, max(0, self.ticks - older.ticks), max(0, self.misses - older.misses),
            max(0, self.skipped - older.skipped),
            self.lateness - older.lateness, self.work - older.work, max(0, self.beyond_work - older.beyond_work),
        )  # fmt: skip

    def __add__(self, other: Loop) -> Loop:
        return Loop(
            self.target_hz, self.ticks + other.ticks, self.misses + other.misses, self.skipped + other.skipped,
            self.lateness + other.lateness, self.work + other.work, self.beyond_work + other.beyond_work,
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Path:
    """Counts of a named path."""

    latency: Latencies
    answered: int
    asked: int

    @classmethod
    def of(cls, body: bodies.PathLatency) -> Path:
        """Return the counts of a path body."""
        return cls(Latencies.of(body.latency), body.answered, body.asked)

    def __sub__(self, older: Path) -> Path:
        return Path(self.latency - older.latency, self.answered - older.answered, self.asked - older.asked)

    def __add__(self, other: Path) -> Path:
        return Path(self.latency + other.latency, self.answered + other.answered, self.asked + other.asked)


@dataclass(frozen=True, slots=True)
class Traffic:
    """Counts of one topic, at one process or summed over processes."""

    sent: int = 0
    received: int = 0
    superseded: int = 0
    dropped: int = 0
    refused: Mapping[str, int] = field(default_factory=dict)
    age: Latencies | None = None

    def __sub__(self, older: Traffic) -> Traffic:
        refused = {reason: count - older.refused.get(reason, 0) for reason, count in self.refused.items()}
        age = self.age - older.age if self.age and older.age else self.age
        return Traffic(
            self.sent - older.sent, self.received - older.received, self.superseded - older.superseded,
            self.dropped - older.dropped, {r: n for r, n in refused.items() if n}, age,
        )  # fmt: skip

    def __add__(self, other: Traffic) -> Traffic:
        refused = {
            reason: self.refused.get(reason, 0) + other.refused.get(reason, 0)
            for reason in (*self.refused, *other.refused)
        }
        age = self.age + other.age if self.age and other.age else self.age or other.age
        return Traffic(
            self.sent + other.sent, self.received + other.received, self.superseded + other.superseded,
            self.dropped + other.dropped, refused, age,
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Stage:
    """Counts of one stage of a tick, in the buckets of `runtime.stage_times`; `max_us` is of the last report."""

    counts: NDArray[np.int64]
    sum_us: float
    max_us: float

    @classmethod
    def of(cls, body: bodies.StageCost) -> Stage:
        """Return the counts of a stage body; one of another size counts as empty."""
        counts = body.counts.view()
        if len(counts) != stage_times.BUCKETS:
            return cls(np.zeros(stage_times.BUCKETS, np.int64), 0.0, body.max_us)
        return cls(np.maximum(counts.astype(np.int64), 0), body.sum_us, body.max_us)

    def quantiles(self) -> Quantiles:
        """Return p50, p99, p99.9 and a bound of the maximum (its bucket's edge) in microseconds."""
        return Quantiles(*(stage_times.quantile_us(self.counts, q) for q in (0.5, 0.99, 0.999, 1.0)))

    def __sub__(self, older: Stage) -> Stage:
        return Stage(np.maximum(self.counts - older.counts, 0), self.sum_us - older.sum_us, self.max_us)

    def __add__(self, other: Stage) -> Stage:
        total_us = self.sum_us + other.sum_us
        return Stage(self.counts + other.counts, total_us, max(self.max_us, other.max_us))


_V = TypeVar("_V", Path, Traffic, Stage)


def _minus(new: Mapping[str, _V], old: Mapping[str, _V]) -> dict[str, _V]:
    return {name: value - old[name] if name in old else value for name, value in new.items()}


def _plus(a: Mapping[str, _V], b: Mapping[str, _V]) -> dict[str, _V]:
    shared = {name: a[name] + b[name] for name in a.keys() & b.keys()}
    return {**a, **b, **shared}


@dataclass(frozen=True, slots=True)
class Figures:
    """All counts of one process over `seconds`."""

    seconds: float
    loop: Loop | None = None
    paths: Mapping[str, Path] = field(default_factory=dict)
    topics: Mapping[str, Traffic] = field(default_factory=dict)
    stages: Mapping[str, Stage] = field(default_factory=dict)

    def __sub__(self, older: Figures) -> Figures:
        loop = self.loop - older.loop if self.loop and older.loop else self.loop
        paths, topics = _minus(self.paths, older.paths), _minus(self.topics, older.topics)
        return Figures(self.seconds - older.seconds, loop, paths, topics, _minus(self.stages, older.stages))

    def __add__(self, other: Figures) -> Figures:
        loop = self.loop + other.loop if self.loop and other.loop else self.loop or other.loop
        paths, topics = _plus(self.paths, other.paths), _plus(self.topics, other.topics)
        return Figures(self.seconds + other.seconds, loop, paths, topics, _plus(self.stages, other.stages))


def contracted(health: bodies.Health) -> Figures:
    """Return the counts that contracts use, ticks and paths, for judging ten times a second."""
    loop, paths = health.loop, {path.name: Path.of(path) for path in health.paths}
    if loop is None:
        return Figures(health.uptime_s, None, paths)
    ticks = Loop(loop.rate_hz, loop.ticks, loop.misses, loop.skipped, _NOTHING, _NOTHING, loop.beyond_work)
    return Figures(health.uptime_s, ticks, paths)


def of(health: bodies.Health, *, stages: bool = False) -> Figures:
    """Return the counts of a process since it began, with those of its stages on request."""
    topics: dict[str, Traffic] = {}
    for report in health.topics:
        age = Latencies.of(report.age) if report.age else None
        traffic = Traffic(
            report.sent, report.received, report.superseded, report.dropped, dict(report.refused), age
        )  # fmt: skip
        topics[report.topic] = topics[report.topic] + traffic if report.topic in topics else traffic
    paths = {path.name: Path.of(path) for path in health.paths}
    loop = Loop.of(health.loop) if health.loop else None
    costs = {stage.name: Stage.of(stage) for stage in health.stages} if stages else {}
    return Figures(health.uptime_s, loop, paths, topics, costs)
