"""What every process says of itself ten times a second. All counts are cumulative: a lost frame loses nothing."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

from trocar.protocol.arrays import Array, spec

_NO_COUNTS = Array("<i4", (0,), b"")


class Histogram(msgspec.Struct, array_like=True, frozen=True, kw_only=True):
    """Counts in log buckets anchored at `deadline_ns`; trocar.services.runtime.measures.histogram has the edges."""

    deadline_ns: Annotated[int, Meta(gt=0, description="itself a bucket edge, so that miss ratios are exact")]
    counts: Annotated[Array, spec("<i8", ("buckets",), "1")]
    total: Annotated[int, Meta(ge=0)] = 0
    sum_ns: int = 0
    max_ns: int = 0


class Stall(msgspec.Struct, array_like=True, frozen=True, kw_only=True):
    """A gap between two starts of a loop's ticks that was many times its period, as the loop itself measured it."""

    index: Annotated[int, Meta(ge=1, description="counts the loop's stalls since its start")]
    ended_ns: Annotated[int, Meta(description="monotonic time at which the loop went on")]
    length_ns: Annotated[int, Meta(ge=0)]


class LoopReport(msgspec.Struct, array_like=True, frozen=True, kw_only=True):
    """A deadline loop since its start."""

    rate_hz: Annotated[float, Meta(gt=0.0)]
    ticks: Annotated[int, Meta(ge=0)]
    misses: Annotated[int, Meta(ge=0, description="finished after the deadline, or never ran")]
    skipped: Annotated[int, Meta(ge=0, description="never ran; part of misses")]
    lateness: Histogram
    work: Histogram
    period: Histogram
    stalls: Annotated[tuple[Stall, ...], Meta(max_length=8, description="the newest")] = ()
    beyond_work: Annotated[int, Meta(ge=0, description="part of misses: less work would not have prevented them")] = 0


class TopicReport(msgspec.Struct, array_like=True, frozen=True, kw_only=True):
    """One topic as this process sees it."""

    topic: Annotated[str, Meta(max_length=64)]
    sent: Annotated[int, Meta(ge=0)] = 0
    received: Annotated[int, Meta(ge=0)] = 0
    superseded: Annotated[int, Meta(ge=0, description="replaced by a newer frame before they were read")] = 0
    dropped: Annotated[int, Meta(ge=0, description="lost although every frame was wanted")] = 0
    refused: Annotated[dict[str, int], Meta(max_length=32, description="by reason")] = {}
    age: Histogram | None = None


class PathLatency(msgspec.Struct, array_like=True, frozen=True, kw_only=True):
    """Latency from the device sample to a named point."""

    name: Annotated[str, Meta(max_length=64)]
    latency: Histogram
    answered: Annotated[int, Meta(ge=0)] = 0
    asked: Annotated[int, Meta(ge=0)] = 0


class StageCost(msgspec.Struct, array_like=True, frozen=True, kw_only=True):
    """What one stage of a tick cost: mean and maximum since the last report, counts since the start.

    The buckets of `counts` are those of trocar.services.runtime.measures.stage_times; it is empty if the process
    does not count.
    """

    name: Annotated[str, Meta(max_length=64)]
    mean_us: float
    max_us: float
    counts: Annotated[Array, spec("<i4", ("stage_buckets",), "1")] = _NO_COUNTS
    sum_us: float = 0.0


class RealtimeFact(msgspec.Struct, array_like=True, frozen=True, kw_only=True):
    """One real-time property: requested and granted."""

    name: Annotated[str, Meta(max_length=64)]
    asked: Annotated[str, Meta(max_length=128)]
    had: Annotated[str, Meta(max_length=256)]
    ok: bool


class Health(msgspec.Struct, array_like=True, frozen=True, kw_only=True):
    """Heartbeat and figures of one process."""

    process: Annotated[str, Meta(max_length=32)]
    pid: Annotated[int, Meta(ge=0)]
    state: Annotated[str, Meta(max_length=16, description="starting, ready, running, degraded, stopping or failed")]
    detail: Annotated[str, Meta(max_length=512)] = ""
    uptime_s: float = 0.0
    loop: LoopReport | None = None
    topics: Annotated[tuple[TopicReport, ...], Meta(max_length=64)] = ()
    paths: Annotated[tuple[PathLatency, ...], Meta(max_length=16)] = ()
    stages: Annotated[tuple[StageCost, ...], Meta(max_length=64)] = ()
    realtime: Annotated[tuple[RealtimeFact, ...], Meta(max_length=32)] = ()
    quality_level: Annotated[int, Meta(ge=0, lt=16)] = 0
    gauges: Annotated[dict[str, float], Meta(max_length=64, description="anything else worth a line")] = {}
