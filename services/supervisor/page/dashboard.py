"""The rig on the dashboard: a snapshot of the supervisor's judgement and the processes' reports.

It is sent as JSON five times a second. Percentiles are over the last window. An unknown number is null, as msgspec
encodes NaN.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import msgspec

import trocar.protocol.bodies as bodies
from trocar.protocol.topics import TOPICS
from trocar.services.diagnosis.thread_usage import Usage, UsageRow
from trocar.services.runtime.config.rig import Rig
from trocar.services.runtime.measures.histogram import Quantiles
from trocar.services.supervisor.judge.figures import Figures, Latencies, Loop, Path, Traffic
from trocar.services.supervisor.judge.figures import of as figures_of
from trocar.services.supervisor.judge.window import Window

UNKNOWN = math.nan


class LoopRow(msgspec.Struct, frozen=True):
    """A loop against its contract."""

    rate_hz: float
    target_hz: float
    ticks: int
    misses: int
    miss_ratio: float
    skipped: int
    lateness_us: Quantiles
    work_us: Quantiles
    contract_ok: bool


class StageRow(msgspec.Struct, frozen=True):
    """Cost of one stage of a tick."""

    name: str
    p50_us: float
    p99_us: float
    max_us: float


class JudgeRow(msgspec.Struct, frozen=True):
    """Lateness of the supervisor's own turns, recently, and the maximum since its start."""

    rate_hz: float
    lateness_us: Quantiles
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
    realtime: tuple[Mapping[str, object], ...]
    stages: tuple[StageRow, ...]
    gauges: Mapping[str, float]
    quality_level: int
    usage: Usage | None
    start: tuple[str, float] | None


class TopicRow(msgspec.Struct, frozen=True):
    """One topic, over all processes that read it."""

    topic: str
    publisher: str
    rate_hz: float
    target_hz: float
    age_us: Quantiles
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


class DashboardSnapshot(msgspec.Struct, frozen=True):
    """The whole rig at one time."""

    t: float
    incarnation: int
    state: str
    reason: str
    start_notice: str
    quality_level: int
    quality: Mapping[str, object]
    safe_stop: bool
    rig: str
    scene: str
    processes: tuple[ProcessRow, ...]
    topics: tuple[TopicRow, ...]
    paths: tuple[PathRow, ...]
    answered_next_tick: float
    heat: Mapping[str, Heat]
    judge: JudgeRow | None
    events: tuple[Mapping[str, object], ...]
    attempt: Mapping[str, object] | None
    replay: Mapping[str, object] | None


@dataclass
class Heard:
    """The newest report of one process, when it came, and its counts of the last `window_s`."""

    window_s: float
    health: bodies.Health | None = None
    heard_s: float = 0.0
    _maxima: deque[tuple[float, dict[str, float]]] = field(default_factory=deque)

    def __post_init__(self) -> None:
        self.window = Window(self.window_s)

    def take_report(self, health: bodies.Health) -> None:
        """Add a report."""
        self.health = health
        self.window.add(health.pid, figures_of(health, stages=True))
        self._maxima.append((health.uptime_s, {stage.name: stage.max_us for stage in health.stages}))
        # A restarted process counts from 0, and who makes up a report may say that its time is no number.
        while len(self._maxima) > 1 and not abs(health.uptime_s - self._maxima[0][0]) <= self.window_s:
            self._maxima.popleft()

    def stage_rows(self) -> tuple[StageRow, ...]:
        """Return the recent costs of stages; the maximum is over the received reports."""
        rows = []
        for name, stage in self.figures.stages.items():
            maximum = max((maxima.get(name, 0.0) for _, maxima in self._maxima), default=UNKNOWN)
            q = stage.quantiles()
            rows.append(StageRow(name, min(q.p50, maximum), min(q.p99, maximum), maximum))
        return tuple(rows)

    @property
    def figures(self) -> Figures:
        """Recent counts."""
        return self.window.figures(self.window_s) or Figures(0.0)


def snapshot(
    state: bodies.SupervisorState,
    told: bodies.Judgement,
    heard: Mapping[str, Heard],
    rig: Rig,
    scene: str,
    threads: Mapping[str, UsageRow] = MappingProxyType({}),
    attempt: bodies.Attempt | None = None,
) -> DashboardSnapshot:
    """Return the rig's state for the page, from the supervisor's state and judgement and the processes' reports."""
    windows = {name: one.figures for name, one in heard.items()}
    broken = set(told.broken)
    paths = {name: path for window in windows.values() for name, path in window.paths.items()}
    model = paths.get("device_model")
    nothing = Heard(rig.supervisor.window_s)
    starts = {each.process: (each.stage, each.fraction) for each in told.starts}
    usage = {name: row.lately for name, row in threads.items()}
    return DashboardSnapshot(
        t=told.t,
        incarnation=told.incarnation,
        state=state.state,
        reason=state.reason,
        start_notice=told.start_notice,
        quality_level=state.quality_level,
        quality=msgspec.structs.asdict(state.quality),
        safe_stop=state.safe_stop,
        rig=rig.name,
        scene=scene,
        processes=tuple(
            process_row(
                process,
                heard.get(process.name, nothing),
                broken,
                usage.get(process.name),
                starts.get(process.name),
            )
            for process in state.processes
        ),
        topics=topic_rows(windows),
        paths=tuple(_path_row(name, path, told.path_limits_us.get(name), broken) for name, path in paths.items()),
        answered_next_tick=model.answered / model.asked if model and model.asked else UNKNOWN,
        heat={name: _heat(window.loop.lateness) for name, window in windows.items() if window.loop},
        judge=_judge_row(heard.get("supervisor", nothing)),
        events=tuple(map(msgspec.structs.asdict, told.events)),
        attempt=None if attempt is None else {**msgspec.structs.asdict(attempt), "answers": ()},
        replay=None if told.replay is None else {**msgspec.structs.asdict(told.replay), "attempt": None},
    )


def _judge_row(heard: Heard) -> JudgeRow | None:
    health, window = heard.health, heard.figures
    if health is None or health.loop is None or window.loop is None:
        return None
    rate_hz = window.loop.ticks / window.seconds if window.seconds > 0 else UNKNOWN
    return JudgeRow(rate_hz, window.loop.lateness.quantiles(), 1e-3 * health.loop.lateness.max_ns)


def process_row(
    process: bodies.ProcessReport,
    heard: Heard,
    broken: set[str],
    usage: Usage | None = None,
    start: tuple[str, float] | None = None,
) -> ProcessRow:
    """Return the row of one process."""
    health, window = heard.health, heard.figures
    kept = f"{process.name} ticks" not in broken
    return ProcessRow(
        name=process.name,
        state=process.state,
        pid=process.pid,
        restarts=process.restarts,
        uptime_s=round(health.uptime_s, 3) if health else 0.0,
        reason=process.reason,
        detail=health.detail if health else "",
        loop=loop_row(window.loop, window.seconds, kept) if window.loop else None,
        realtime=tuple(map(msgspec.structs.asdict, health.realtime)) if health else (),
        stages=heard.stage_rows(),
        gauges=health.gauges if health else {},
        quality_level=health.quality_level if health else 0,
        usage=usage,
        start=start,
    )


def loop_row(loop: Loop, seconds: float, kept: bool) -> LoopRow:
    """Return the row of a loop that ran for `seconds`."""
    return LoopRow(
        rate_hz=loop.ticks / seconds if seconds > 0 else UNKNOWN,
        target_hz=loop.target_hz,
        ticks=loop.ticks,
        misses=loop.misses,
        miss_ratio=loop.miss_ratio,
        skipped=loop.skipped,
        lateness_us=loop.lateness.quantiles(),
        work_us=loop.work.quantiles(),
        contract_ok=kept,
    )


def topic_rows(windows: Mapping[str, Figures]) -> tuple[TopicRow, ...]:
    """Return a row for every topic sent or read in the windows of the processes."""
    together: dict[str, Traffic] = {}
    rates: dict[str, float] = {}
    for window in windows.values():
        for name, traffic in window.topics.items():
            together[name] = together[name] + traffic if name in together else traffic
            if traffic.sent and window.seconds > 0:
                rates[name] = traffic.sent / window.seconds
    return tuple(
        TopicRow(
            topic=name,
            publisher=row.publisher,
            rate_hz=rates.get(name, UNKNOWN),
            target_hz=row.rate_hz,
            age_us=_quantiles(together[name].age),
            drops=together[name].dropped,
            superseded=together[name].superseded,
            refused=dict(together[name].refused),
        )
        for name, row in TOPICS.items()
        if name in together
    )


def _path_row(name: str, path: Path, limit_us: float | None, broken: set[str]) -> PathRow:
    q = path.latency.quantiles()
    return PathRow(name, q.p50, q.p99, q.p99_9, q.max, limit_us, f"path {name}" not in broken)


def _quantiles(latencies: Latencies | None) -> Quantiles:
    return Quantiles() if latencies is None else latencies.quantiles()


def _heat(latencies: Latencies) -> Heat:
    edges, counts = latencies.coarse()
    return Heat(edges.round(3).tolist(), counts.tolist())
