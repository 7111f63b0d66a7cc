"""What the dashboard shows: typed rows of one snapshot of the rig, which the page gets as JSON.

Percentiles are over the last window. A number that is not known is null: NaN becomes null in msgspec's JSON.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import msgspec

UNKNOWN = math.nan


class Spread(msgspec.Struct, frozen=True):
    """Quantiles in microseconds."""

    p50: float = UNKNOWN
    p99: float = UNKNOWN
    p99_9: float = UNKNOWN
    max: float = UNKNOWN


class LoopRow(msgspec.Struct, frozen=True):
    """A loop against its contract."""

    rate_hz: float
    target_hz: float
    ticks: int
    misses: int
    miss_ratio: float
    skipped: int
    lateness_us: Spread
    work_us: Spread
    contract_ok: bool


class FactRow(msgspec.Struct, frozen=True):
    """A real-time property: asked for, and had."""

    name: str
    asked: str
    had: str
    ok: bool


class StageRow(msgspec.Struct, frozen=True):
    """Cost of one stage of a tick."""

    name: str
    p50_us: float
    p99_us: float
    max_us: float


class UsageRow(msgspec.Struct, frozen=True):
    """What the kernel counted of a process, and of what it has started, in the last `seconds`, about one."""

    wakeups_per_s: float
    switches_per_s: float
    processor_share: float
    waited_share: float
    seconds: float


class FloorRow(msgspec.Struct, frozen=True):
    """The machine on one core: of a thread above everybody, wake-ups over a millisecond late in the last minute."""

    core: int
    wakeups: int
    late: int
    late_ratio: float
    lateness_us: Spread


class JudgeRow(msgspec.Struct, frozen=True):
    """The supervisor's own turns: how late they began lately, and the latest since it began."""

    rate_hz: float
    lateness_us: Spread
    latest_us: float


class ProcessRow(msgspec.Struct, frozen=True):
    """One process."""

    name: str
    state: str
    pid: int
    restarts: int
    uptime_s: float
    reason: str
    detail: str
    loop: LoopRow | None
    realtime: tuple[FactRow, ...]
    stages: tuple[StageRow, ...]
    gauges: Mapping[str, float]
    quality_level: int
    usage: UsageRow | None


class TopicRow(msgspec.Struct, frozen=True):
    """One topic, over all processes that read it."""

    topic: str
    publisher: str
    rate_hz: float
    target_hz: float
    age_us: Spread
    drops: int
    superseded: int
    refused: Mapping[str, int]


class PathRow(msgspec.Struct, frozen=True):
    """One latency path against its contract."""

    name: str
    p50: float
    p99: float
    p99_9: float
    max: float
    limit_p99: float | None
    ok: bool


class Heat(msgspec.Struct, frozen=True):
    """Lateness of a loop in coarse buckets; the last count is of the open bucket."""

    edges_us: list[float]
    counts: list[int]


class EventRow(msgspec.Struct, frozen=True):
    """A line of the event list."""

    t: float
    level: str
    text: str


class QualityRow(msgspec.Struct, frozen=True):
    """The rung of quality in force: what a tick of it costs, and what it costs in accuracy, as far as measured."""

    name: str
    rungs: int
    cost_us: float | None
    force_error_percent: float | None
    motion_error_percent: float | None
    lowered: int
    raised: int


class Snapshot(msgspec.Struct, frozen=True):
    """The whole rig at one time."""

    t: float
    state: str
    reason: str
    quality_level: int
    quality: QualityRow
    safe_stop: bool
    rig: str
    scene: str
    processes: tuple[ProcessRow, ...]
    topics: tuple[TopicRow, ...]
    paths: tuple[PathRow, ...]
    answered_next_tick: float
    heat: Mapping[str, Heat]
    floor: tuple[FloorRow, ...]
    judge: JudgeRow | None
    flight: str
    events: tuple[EventRow, ...]
