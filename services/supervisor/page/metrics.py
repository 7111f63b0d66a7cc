"""Prometheus metrics of the whole rig, from the counts reported by the processes; loops are never scraped themselves.

There are two levels: a summary for alerts and dashboards of many rigs, with at most 200 series, and all histograms.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from importlib import metadata
from typing import Literal, TypeVar

import prometheus_client
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, HistogramMetricFamily, Metric

import trocar.protocol.bodies as bodies
from trocar.services.diagnosis.thread_usage import UsageRow
from trocar.services.runtime.config.rig import Contracts
from trocar.services.runtime.measures import stage_times
from trocar.services.supervisor.judge.figures import Latencies, Stage
from trocar.services.supervisor.judge.state_machine import RigState
from trocar.services.supervisor.page import task_metrics

Level = Literal["summary", "full"]
_Family = TypeVar("_Family", CounterMetricFamily, GaugeMetricFamily)
#: Prefix of gauges ``device_link_up.<device>``, which are a metric of their own.
LINK = "device_link_up"
#: Gauges of the recorder that are metrics of their own: name, whether it is a counter, and description.
_RECORDER = {
    "recorded_frames": ("trocar_recorder_frames", CounterMetricFamily, "Frames in the recording"),
    "lost_frames": ("trocar_recorder_lost_frames", CounterMetricFamily, "Frames that the recording lacks"),
    "waiting_for_disk_bytes": ("trocar_recorder_waiting_bytes", GaugeMetricFamily, "Bytes not yet written to the disk"),
    "disk_free_bytes": ("trocar_recorder_disk_free_bytes", GaugeMetricFamily, "Free space where recordings are kept"),
}
#: Buckets of stages are two to a doubling, not four, so that a scrape has at most 200 series.
_EVERY = 2
#: Edges of paths in the summary, as fractions of the path's limit.
_PARTS = (0.25, 0.5, 0.71, 1.0, 1.42, 2.0, 4.0)


@dataclass(frozen=True, slots=True)
class RigSource:
    """The exported rig: its judgement, the newest report of each process, and the kernel's counts of its threads.

    `is_judged` tells whether the supervisor itself is up; `task` has the metrics of attempts.
    """

    state: bodies.SupervisorState
    heard: Mapping[str, bodies.Health] = field(default_factory=dict)
    threads: Mapping[str, UsageRow] = field(default_factory=dict)
    is_judged: bool = False
    contracts: Contracts = field(default_factory=Contracts)
    task: task_metrics.Task = field(default_factory=task_metrics.Task)


class RigCollector:
    """Converts the newest reports to metric families at each scrape. Counts restart at 0 with a process."""

    def __init__(self, source: Callable[[], RigSource], level: Level = "full") -> None:
        self._source = source
        self._level = level

    def collect(self) -> Iterator[Metric]:
        """Yield every metric family of the level."""
        rig, full = self._source(), self._level == "full"
        yield from _rig(rig.state)
        yield from _services(rig)
        heard = list(rig.heard.values())
        yield from _loops(heard, full)
        yield from _limits(rig.contracts)
        yield _paths(heard, full)
        yield from _links(heard)
        yield from _recorder(heard)
        yield from task_metrics.families(rig.task)
        yield from _threads(rig.threads, full)
        if full:
            yield from _topics(heard)
            yield _gauges(heard)
            yield from _stages(heard)


def registry(source: Callable[[], RigSource], level: Level = "full") -> prometheus_client.CollectorRegistry:
    """Return a registry with only the rig's metrics of a level."""
    made = prometheus_client.CollectorRegistry()
    made.register(RigCollector(source, level))
    return made


def _rig(rig: bodies.SupervisorState) -> Iterator[Metric]:
    states = {str(value): float(value == rig.state) for value in RigState}
    version = {metadata.version("trocar"): 1.0}
    yield _by("version", GaugeMetricFamily, "trocar_build_info", "Version of the rig", version)
    yield _by("state", GaugeMetricFamily, "trocar_rig_state", "1 for the state that the rig is in", states)
    yield GaugeMetricFamily("trocar_quality_level", "Quality level set, 0 is the best", value=rig.quality_level)
    yield from _quality(rig.quality)
    yield GaugeMetricFamily("trocar_safe_stop", "1 while the arms are limp until armed", value=float(rig.safe_stop))


def _quality(quality: bodies.QualityReport) -> Iterator[Metric]:
    """Yield the measured cost of the present quality level, and the number of its changes."""
    if quality.cost_us is not None:
        yield GaugeMetricFamily(
            "trocar_quality_cost_seconds", "A tick of the rung in force", value=1e-6 * quality.cost_us
        )
    percent = {"force": quality.force_error_percent, "motion": quality.motion_error_percent}
    errors = {of: 0.01 * error for of, error in percent.items() if error is not None}
    switches = {"down": quality.lowered, "up": quality.raised}
    yield _by("of", GaugeMetricFamily, "trocar_quality_error_ratio", "Error of the rung in force", errors)
    yield _by("direction", CounterMetricFamily, "trocar_quality_switches", "Changes of the rung", switches)


def _services(rig: RigSource) -> Iterator[Metric]:
    up = {process.name: float(process.state == "ready") for process in rig.state.processes}
    up["supervisor"] = float(rig.is_judged)
    restarts = {process.name: process.restarts for process in rig.state.processes} | {"supervisor": 0}
    uptime = {name: health.uptime_s for name, health in rig.heard.items()}
    lost = {n: sum(t.dropped + sum(t.refused.values()) for t in health.topics) for n, health in rig.heard.items()}
    text = "From the start of a process to its newest report"
    yield _by("service", GaugeMetricFamily, "trocar_service_up", "1 while a process is ready and sends heartbeats", up)
    yield _by("service", CounterMetricFamily, "trocar_service_restarts", "Restarts by the supervisor", restarts)
    yield _by("service", GaugeMetricFamily, "trocar_service_uptime_seconds", text, uptime)
    yield _by("service", CounterMetricFamily, "trocar_service_drops", "Frames that the process lost or refused", lost)


_LOOP_TIMES = {
    "lateness": "Start of a tick after its deadline",
    "period": "Time from tick to tick",
    "work": "Work of a tick",
}


def _loops(heard: Iterable[bodies.Health], full: bool) -> Iterator[Metric]:
    times = {name: _histogram(f"trocar_loop_{name}_seconds", text, "loop") for name, text in _LOOP_TIMES.items()}
    longest = {name: _longest(f"trocar_loop_{name}", "loop") for name in _LOOP_TIMES}
    ticks = CounterMetricFamily("trocar_loop_iterations", "Ticks that ran", labels=["loop"])
    skips = CounterMetricFamily("trocar_loop_skipped", "Ticks that never ran", labels=["loop"])
    misses = CounterMetricFamily("trocar_deadline_misses", "Ticks that finished late or never ran", labels=["loop"])
    for health in heard:
        if health.loop is None:
            continue
        for name in _LOOP_TIMES:
            counted: bodies.Histogram = getattr(health.loop, name)
            if full:
                _add(times[name], health.process, Latencies.of(counted))
            longest[name].add_metric([health.process], counted.max_ns / 1e9)
        ticks.add_metric([health.process], health.loop.ticks)
        skips.add_metric([health.process], health.loop.skipped)
        misses.add_metric([health.process], health.loop.misses)
    yield from (longest["lateness"], longest["work"], ticks, skips, misses)
    if full:
        yield from (*times.values(), longest["period"])


def _limits(contracts: Contracts) -> Iterator[Metric]:
    """Yield the limits of the rig file, by which alerts apply a rig's own contracts."""
    lost = {name: loop.miss_ratio for name, loop in contracts.loops.items()}
    p99 = {name: path.p99_us / 1e6 for name, path in contracts.paths.items()}
    yield _by("loop", GaugeMetricFamily, "trocar_loop_miss_ratio_limit", "Share of ticks that may be lost", lost)
    yield _by("path", GaugeMetricFamily, "trocar_path_limit_seconds", "Limit of the 99th percentile of a latency", p99)


def _paths(heard: Iterable[bodies.Health], full: bool) -> Metric:
    family = _histogram("trocar_path_latency_seconds", "Latency from the device sample, by path", "path")
    for health in heard:
        for path in health.paths:
            _add(family, path.name, Latencies.of(path.latency), few=not full)
    return family


def _topics(heard: Iterable[bodies.Health]) -> Iterator[Metric]:
    age = HistogramMetricFamily("trocar_topic_age_seconds", "Age of a frame when read", labels=["topic", "reader"])
    sent = CounterMetricFamily("trocar_topic_messages", "Frames sent", labels=["topic"])
    drops = CounterMetricFamily("trocar_topic_drops", "Frames lost or refused", labels=["topic", "reader", "reason"])
    for health in heard:
        for report in health.topics:
            if report.sent:
                sent.add_metric([report.topic], report.sent)
            if report.age is not None and report.age.total:
                _add(age, report.topic, Latencies.of(report.age), health.process)
            for reason, count in {"lost": report.dropped, **report.refused}.items():
                drops.add_metric([report.topic, health.process, reason], count)
    yield from (age, sent, drops)


def _links(heard: Iterable[bodies.Health]) -> Iterator[Metric]:
    link = GaugeMetricFamily("trocar_device_link_up", "1 while a device answers", labels=["service", "name"])
    for health in heard:
        for name, value in health.gauges.items():
            if name.startswith(f"{LINK}."):
                link.add_metric([health.process, name.partition(".")[2]], value)
    yield link


def _recorder(heard: Iterable[bodies.Health]) -> Iterator[Metric]:
    said = next((health.gauges for health in heard if health.process == "recorder"), {})
    for gauge, (name, family, text) in _RECORDER.items():
        yield family(name, text, value=said[gauge]) if gauge in said else family(name, text, labels=())


def _gauges(heard: Iterable[bodies.Health]) -> Metric:
    other = GaugeMetricFamily("trocar_gauge", "Any other figure that a process reports", labels=["service", "name"])
    for health in heard:
        for name, value in health.gauges.items():
            if not name.startswith(f"{LINK}.") and not (health.process == "recorder" and name in _RECORDER):
                other.add_metric([health.process, name], value)
    return other


def _stages(heard: Iterable[bodies.Health]) -> Iterator[Metric]:
    longest = _longest("trocar_stage", "loop", "stage")
    family = HistogramMetricFamily("trocar_stage_seconds", "One stage of a tick", labels=["loop", "stage"])
    bounds = [*(f"{edge / 1e9:.9g}" for edge in stage_times.edges_ns()[_EVERY - 1 :: _EVERY]), "+Inf"]
    for health in heard:
        for body in health.stages:
            stage = Stage.of(body)
            cumulative = stage.counts.cumsum()
            counts = [*cumulative[_EVERY - 1 : -1 : _EVERY], cumulative[-1]]
            buckets = [(bound, int(count)) for bound, count in zip(bounds, counts, strict=True)]
            family.add_metric([health.process, body.name], buckets, stage.sum_us / 1e6)
            if cumulative[-1]:  # the bucket's edge, as the exact maximum is known only for the last report's time
                longest.add_metric([health.process, body.name], stage.quantiles().max / 1e6)
    yield from (family, longest)


def _threads(threads: Mapping[str, UsageRow], full: bool) -> Iterator[Metric]:
    counts = {name: row.since_start for name, row in threads.items()}
    ran = {name: each.ran_ns / 1e9 for name, each in counts.items()}
    waited = {name: each.waited_ns / 1e9 for name, each in counts.items()}
    yield _by("service", CounterMetricFamily, "trocar_processor_seconds", "Time on a processor", ran)
    yield _by("service", CounterMetricFamily, "trocar_waited_seconds", "Time spent waiting for a processor", waited)
    if full:
        text = "Context switches of the threads that live now; each wake-up ends in a voluntary one"
        switches = CounterMetricFamily("trocar_context_switches", text, labels=["service", "kind"])
        for name, each in counts.items():
            switches.add_metric([name, "wanted"], each.woken)
            switches.add_metric([name, "preempted"], each.preempted)
        yield switches


def _by(label: str, kind: type[_Family], name: str, text: str, values: Mapping[str, float]) -> _Family:
    """Return a family of metrics with one label."""
    family = kind(name, text, labels=[label])
    for key, value in values.items():
        family.add_metric([key], value)
    return family


def _longest(name: str, *labels: str) -> GaugeMetricFamily:
    return GaugeMetricFamily(f"{name}_max_seconds", f"Longest {name}_seconds since its start", labels=labels)


def _histogram(name: str, text: str, label: str) -> HistogramMetricFamily:
    return HistogramMetricFamily(name, text, labels=[label])


def _add(family: HistogramMetricFamily, label: str, latencies: Latencies, *more: str, few: bool = False) -> None:
    edges_us, counts = latencies.coarse()
    cumulative = counts.cumsum()
    parts = edges_us * 1e3 / max(latencies.deadline_ns, 1)
    chosen = sorted({int(abs(parts - part).argmin()) for part in _PARTS}) if few else range(len(edges_us))
    buckets = [(f"{edges_us[k] / 1e6:.9g}", int(cumulative[k])) for k in chosen]
    family.add_metric([label, *more], [*buckets, ("+Inf", int(cumulative[-1]))], latencies.sum_ns / 1e9)
