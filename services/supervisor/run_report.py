"""What a run of a given length did: the object that ``trocar up --seconds N --json FILE`` writes.

Only the time in which the rig was RUNNING and had settled counts: what processes counted between then and the moment
in which it was asked to end. While it ends, hands are let go one process after the other, and nothing is late.
"""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Mapping
from dataclasses import asdict
from datetime import UTC, datetime
from importlib import metadata
from math import isfinite
from typing import Any

import protocol.bodies as bodies
from services.runtime.machine import processor_name
from services.supervisor.figures import Figures, Latencies, Traffic
from services.supervisor.state_machine import RigState
from services.supervisor.stays import Stays
from services.supervisor.supervisor import Supervisor
from services.supervisor.window import Tally

#: After RUNNING: start-up tails out of queues and caches.
SETTLE_S = 1.0
_PACKAGES = ("trocar", "numpy", "scipy", "numba", "pyzmq", "msgspec")


class RunReport:
    """Collects the counts of one run."""

    def __init__(self, supervisor: Supervisor) -> None:
        self._supervisor = supervisor
        self._tallies: dict[str, Tally] = {}
        self._stays = Stays()
        self._running_s: float | None = None
        self._restarts: dict[str, int] = {}
        self._start_s: float | None = None
        self._end_s = 0.0
        self._state = supervisor.state
        self._realtime: dict[str, tuple[bodies.RealtimeFact, ...]] = {}
        self._own_before: Latencies | None = None
        self._recorder: bodies.Health | None = None
        supervisor.crew.on_report = self._add

    @property
    def measured_s(self) -> float:
        """Seconds that count so far."""
        return 0.0 if self._start_s is None else self._end_s - self._start_s

    def turn(self, now_s: float) -> None:
        """Follow the supervisor; to be called after every turn of it."""
        if self._running_s is None and self._supervisor.state is RigState.RUNNING:
            self._running_s = now_s
        if self._start_s is None and self._running_s is not None and now_s - self._running_s >= SETTLE_S:
            self._start_s = now_s
            self._restarts = self._restart_counts()
            self._own_before = self._own_lateness()
            self._tallies = {m.name: Tally(m.health) for m in self._supervisor.crew.members.values()}
            self._stays.begin(m.health for m in self._supervisor.crew.members.values() if m.health is not None)
        if self._start_s is not None:
            governor = self._supervisor.enforcement.governor
            self._stays.turn(now_s, governor.level, governor.rung)
        self._end_s = now_s
        self._state = self._supervisor.state
        for name, member in self._supervisor.crew.members.items():
            if member.health is not None:
                self._realtime[name] = member.health.realtime
                if name == "recorder":
                    self._recorder = member.health

    def result(self) -> dict[str, Any]:
        """Return the object, every number finite or None."""
        counts = {name: tally.counts() for name, tally in self._tallies.items()}
        paths = {name: path for figures in counts.values() for name, path in figures.paths.items()}
        model = paths.get("device_model")
        restarts = {name: n - self._restarts.get(name, 0) for name, n in self._restart_counts().items()}
        return {
            "seconds": round(self.measured_s, 3),
            "seconds_to_running": None
            if self._running_s is None
            else round(self._running_s - self._supervisor.started_s, 3),
            "loops": {name: _loop(figures) for name, figures in counts.items() if figures.loop is not None},
            "paths": {name: _quantiles(path.latency) for name, path in paths.items()},
            "answered_next_tick": model.answered / model.asked if model and model.asked else None,
            "topics": _topics(counts),
            "restarts": restarts,
            "supervisor": self._own(),
            "recording": _recording(self._recorder),
            "realtime": {name: [_fact(fact) for fact in facts] for name, facts in self._realtime.items()},
            "rig": self._supervisor.rig.name,
            "quality_level": self._supervisor.enforcement.level,
            "rungs": self._stays.bodies(),
            "state": str(self._state),
            "events": [asdict(event) for event in self._supervisor.events],
            "machine": machine(),
        }

    def _own_lateness(self) -> Latencies | None:
        meter = self._supervisor.meter
        return None if meter is None else Latencies.of(meter.lateness.body())

    def _own(self) -> dict[str, Any] | None:
        """Return how late the supervisor's own turns were."""
        now, before = self._own_lateness(), self._own_before
        return {"lateness_us": _quantiles(now - before)} if now is not None and before is not None else None

    def _add(self, name: str, health: bodies.Health) -> None:
        if self._start_s is not None and self._supervisor.state is not RigState.OFF:
            self._tallies[name].add(health)
            self._stays.add(health)

    def _restart_counts(self) -> dict[str, int]:
        return {name: member.restarts.count for name, member in self._supervisor.crew.members.items()}


def _recording(health: bodies.Health | None) -> dict[str, Any] | None:
    """Return how many frames were recorded and how many lost since the recorder began, and why, as it said last."""
    if health is None or "recorded_frames" not in health.gauges:
        return None
    frames, lost = health.gauges["recorded_frames"], health.gauges["lost_frames"]
    return {"frames": int(frames), "lost": int(lost), "why": health.detail}


def _loop(figures: Figures) -> dict[str, Any]:
    loop = figures.loop
    assert loop is not None
    return {
        "rate_hz": _finite(loop.ticks / figures.seconds) if figures.seconds > 0 else None,
        "target_hz": _finite(loop.target_hz),
        "ticks": loop.ticks,
        "misses": loop.misses,
        "skipped": loop.skipped,
        "miss_ratio": _finite(loop.miss_ratio),
        "lateness_us": _quantiles(loop.lateness),
        "work_us": _quantiles(loop.work),
    }


def _quantiles(latencies: Latencies) -> dict[str, float | None]:
    return {name: _finite(value) for name, value in asdict(latencies.quantiles()).items()}


def _finite(value: float) -> float | None:
    return value if isfinite(value) else None


def _topics(counts: Mapping[str, Figures]) -> dict[str, dict[str, Any]]:
    together: dict[str, Traffic] = {}
    seconds: dict[str, float] = {}
    for figures in counts.values():
        for name, traffic in figures.topics.items():
            together[name] = together[name] + traffic if name in together else traffic
            if traffic.sent:
                seconds[name] = figures.seconds
    return {
        name: {
            "rate_hz": _finite(traffic.sent / seconds[name]) if seconds.get(name) else None,
            "drops": traffic.dropped,
            "superseded": traffic.superseded,
            "refused": dict(traffic.refused),
            "age_p99_us": None if traffic.age is None else _quantiles(traffic.age)["p99"],
        }
        for name, traffic in sorted(together.items())
    }


def _fact(fact: bodies.RealtimeFact) -> dict[str, Any]:
    return {"name": fact.name, "asked": fact.asked, "had": fact.had, "ok": fact.ok}


def machine() -> dict[str, Any]:
    """Return what the figures were measured on."""
    return {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "cpu": processor_name(),
        "cores": os.cpu_count(),
        "kernel": platform.release(),
        "python": platform.python_version(),
        "packages": {name: metadata.version(name) for name in _PACKAGES if _installed(name)},
    }


def _installed(name: str) -> bool:
    try:
        metadata.version(name)
    except metadata.PackageNotFoundError:
        return False
    return True


def as_text(result: Mapping[str, Any]) -> str:
    """Return `result` as the JSON of a file."""
    return json.dumps(result, indent=1, allow_nan=False) + "\n"
