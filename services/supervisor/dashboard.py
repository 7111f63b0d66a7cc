"""The rig as the dashboard shows it: one snapshot, made from what the supervisor judges and what processes said.

It is sent as JSON five times a second. Percentiles are over the last window.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field

import msgspec

import protocol.bodies as bodies
from protocol.topics import TOPICS
from services.runtime.histogram import Quantiles
from services.runtime.rig import Rig
from services.supervisor.figures import Figures, Latencies, Loop, Path, Traffic
from services.supervisor.figures import of as figures_of
from services.supervisor.notes import MemberNote, Notes
from services.supervisor.rows import (
    UNKNOWN,
    EventRow,
    FactRow,
    FloorRow,
    Heat,
    JudgeRow,
    LoopRow,
    PathRow,
    ProcessRow,
    QualityRow,
    Snapshot,
    Spread,
    StageRow,
    TopicRow,
    UsageRow,
)
from services.supervisor.threads import Usage
from services.supervisor.window import Window

EVENTS_SHOWN = 50


@dataclass
class Heard:
    """What one process said last, and what it counted lately."""

    health: bodies.Health | None
    window: Window
    window_s: float
    _maxima: deque[tuple[float, dict[str, float]]] = field(default_factory=deque)

    @classmethod
    def nothing(cls, window_s: float) -> Heard:
        """Nothing yet; figures will be of the last `window_s`."""
        return cls(None, Window(window_s), window_s)

    def take(self, health: bodies.Health) -> None:
        """Take a report."""
        self.health = health
        self.window.add(health.pid, figures_of(health, stages=True))
        self._maxima.append((health.uptime_s, {stage.name: stage.max_us for stage in health.stages}))
        while abs(health.uptime_s - self._maxima[0][0]) > self.window_s:  # a restarted process counts from 0
            self._maxima.popleft()

    def stage_rows(self) -> tuple[StageRow, ...]:
        """Return what stages cost lately; the maximum is of the reports that were heard."""
        rows = []
        for name, stage in self.figures.stages.items():
            maximum = max((maxima.get(name, 0.0) for _, maxima in self._maxima), default=UNKNOWN)
            q = stage.quantiles()
            rows.append(StageRow(name, min(q.p50, maximum), min(q.p99, maximum), maximum))
        return tuple(rows)

    @property
    def figures(self) -> Figures:
        """What was counted lately."""
        return self.window.figures(self.window_s) or Figures(0.0)


@dataclass(frozen=True, slots=True)
class Surroundings:
    """What the kernel and the machine say beside the rig: floor by core, threads by process, the last flight's file."""

    floor: Mapping[int, Latencies] = field(default_factory=dict)
    usage: Mapping[str, Usage] = field(default_factory=dict)
    flight: str = ""


def snapshot(
    notes: Notes, heard: Mapping[str, Heard], rig: Rig, scene: str, around: Surroundings | None = None
) -> Snapshot:
    """Return what the page shows of the rig now: as the supervisor judges it, and as the processes were heard."""
    around = around or Surroundings()
    windows = {name: one.figures for name, one in heard.items()}
    broken = set(notes.broken)
    paths = {name: path for window in windows.values() for name, path in window.paths.items()}
    model = paths.get("device_model")
    nothing = Heard.nothing(rig.supervisor.window_s)
    return Snapshot(
        t=round(notes.said_s - notes.started_s, 3),
        state=notes.state,
        reason=notes.reason,
        quality_level=notes.quality_level,
        quality=QualityRow(**msgspec.structs.asdict(notes.quality)),
        safe_stop=notes.safe_stop,
        rig=rig.name,
        scene=scene,
        processes=tuple(
            process_row(member, heard.get(member.name, nothing), broken, around.usage.get(member.name))
            for member in notes.members
        ),
        topics=topic_rows(windows),
        paths=tuple(_path_row(name, path, notes.path_limits_us.get(name), broken) for name, path in paths.items()),
        answered_next_tick=model.answered / model.asked if model and model.asked else UNKNOWN,
        heat={name: _heat(window.loop.lateness) for name, window in windows.items() if window.loop},
        floor=tuple(_floor_row(core, latencies) for core, latencies in sorted(around.floor.items())),
        judge=_judge_row(heard.get("supervisor", nothing)),
        flight=around.flight,
        events=tuple(EventRow(round(e.t, 3), e.level, e.text) for e in notes.events[-EVENTS_SHOWN:]),
    )


def _floor_row(core: int, latencies: Latencies) -> FloorRow:
    total = latencies.total
    ratio = latencies.late / total if total else UNKNOWN
    return FloorRow(core, total, latencies.late, ratio, spread(latencies))


def _judge_row(heard: Heard) -> JudgeRow | None:
    health, window = heard.health, heard.figures
    if health is None or health.loop is None or window.loop is None:
        return None
    rate_hz = window.loop.ticks / window.seconds if window.seconds > 0 else UNKNOWN
    return JudgeRow(rate_hz, spread(window.loop.lateness), 1e-3 * health.loop.lateness.max_ns)


def process_row(member: MemberNote, heard: Heard, broken: set[str], usage: Usage | None = None) -> ProcessRow:
    """Return the row of one process."""
    health, window = heard.health, heard.figures
    kept = f"{member.name} ticks" not in broken
    return ProcessRow(
        name=member.name,
        state=member.state,
        pid=member.pid,
        restarts=member.restarts,
        uptime_s=round(health.uptime_s, 3) if health else 0.0,
        reason=member.reason,
        detail=health.detail if health else "",
        loop=loop_row(window.loop, window.seconds, kept) if window.loop else None,
        realtime=tuple(FactRow(f.name, f.asked, f.had, f.ok) for f in health.realtime) if health else (),
        stages=heard.stage_rows(),
        gauges=health.gauges if health else {},
        quality_level=health.quality_level if health else 0,
        usage=UsageRow(**asdict(usage)) if usage is not None else None,
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
        lateness_us=spread(loop.lateness.quantiles()),
        work_us=spread(loop.work.quantiles()),
        contract_ok=kept,
    )


def topic_rows(windows: Mapping[str, Figures]) -> tuple[TopicRow, ...]:
    """Return a row for every topic that somebody sent or read in the windows of the processes."""
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
            age_us=spread(together[name].age),
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


def spread(values: Quantiles | Latencies | None) -> Spread:
    """Return quantiles as they are shown."""
    if values is None:
        return Spread()
    q = values.quantiles() if isinstance(values, Latencies) else values
    return Spread(q.p50, q.p99, q.p99_9, q.max)


def _heat(latencies: Latencies) -> Heat:
    edges, counts = latencies.coarse()
    return Heat(edges.round(3).tolist(), counts.tolist())
