"""Report of a run of a given length, the object that ``trocar up --seconds N --json FILE`` writes.

It covers the time from when the rig is RUNNING and settled until it is told to end. While it ends, forces are removed
and processes end one after the other, and nothing counts as late.
"""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Mapping
from datetime import UTC, datetime
from importlib import metadata
from typing import Any

import msgspec

import trocar.protocol.bodies as bodies
from trocar.services.runtime.realtime.machine import processor_name
from trocar.services.supervisor.control.supervisor import Supervisor
from trocar.services.supervisor.judge.figures import Latencies, Loop
from trocar.services.supervisor.judge.state_machine import RigState
from trocar.services.supervisor.page.dashboard import TopicRow, loop_row, topic_rows
from trocar.services.supervisor.run_counts import RunCounts

#: Time after RUNNING that is left out, for effects of the start in queues and caches.
SETTLE_S = 1.0
_PACKAGES = ("trocar", "numpy", "scipy", "numba", "pyzmq", "msgspec")


class RunReport:
    """Collects the counts of one run."""

    def __init__(self, supervisor: Supervisor) -> None:
        self._supervisor = supervisor
        self._counts = RunCounts()
        self._running_s: float | None = None
        self._restarts: dict[str, int] = {}
        self._state = supervisor.state
        self._realtime: dict[str, tuple[bodies.RealtimeFact, ...]] = {}
        self._own_before: Latencies | None = None
        self._recorder: bodies.Health | None = None
        supervisor.crew.on_report = self._add

    @property
    def measured_s(self) -> float:
        """Counted seconds so far."""
        return self._counts.seconds

    def watch_run(self, now_s: float) -> None:
        """Follow the supervisor; call this after each of its turns."""
        if self._running_s is None and self._supervisor.state is RigState.RUNNING:
            self._running_s = now_s
        has_settled = self._running_s is not None and now_s - self._running_s >= SETTLE_S
        if has_settled and not self._counts.has_begun:
            self._restarts = self._restart_counts()
            self._own_before = self._own_lateness()
            self._counts.begin_counting(
                m.health for m in self._supervisor.crew.members.values() if m.health is not None
            )
        if has_settled:
            governor = self._supervisor.enforcement.governor
            self._counts.record_level(now_s, governor.level, governor.rung.name)
        self._state = self._supervisor.state
        for name, member in self._supervisor.crew.members.items():
            if member.health is not None:
                self._realtime[name] = member.health.realtime
                if name == "recorder":
                    self._recorder = member.health

    def result(self) -> dict[str, Any]:
        """Return the report, with every number finite or None."""
        counts = self._counts.totals()
        paths = {name: path for figures in counts.values() for name, path in figures.paths.items()}
        model = paths.get("device_model")
        restarts = {name: n - self._restarts.get(name, 0) for name, n in self._restart_counts().items()}
        began_s, running_s = self._supervisor.started_s, self._running_s
        result = {
            "seconds": round(self.measured_s, 3),
            "seconds_to_running": None if running_s is None else round(running_s - began_s, 3),
            "loops": {name: _loop(figures.loop, figures.seconds) for name, figures in counts.items() if figures.loop},
            "paths": {name: path.latency.quantiles() for name, path in paths.items()},
            "answered_next_tick": model.answered / model.asked if model and model.asked else None,
            "topics": {row.topic: _topic(row) for row in topic_rows(counts)},
            "restarts": restarts,
            "supervisor": self._own(),
            "recording": _recording(self._recorder),
            "realtime": {name: list(map(msgspec.structs.asdict, facts)) for name, facts in self._realtime.items()},
            "rig": self._supervisor.rig.name,
            "quality_level": self._supervisor.enforcement.level,
            "rungs": self._counts.rungs(),
            "state": str(self._state),
            "events": list(map(msgspec.structs.asdict, self._supervisor.events)),
            "machine": machine(),
        }
        plain: dict[str, Any] = json.loads(msgspec.json.encode(result))  # encodes NaN and infinity as null
        return plain

    def _own_lateness(self) -> Latencies | None:
        meter = self._supervisor.meter
        return None if meter is None else Latencies.of(meter.lateness.body())

    def _own(self) -> dict[str, Any] | None:
        """Return the lateness of the supervisor's own turns."""
        now, before = self._own_lateness(), self._own_before
        return {"lateness_us": (now - before).quantiles()} if now is not None and before is not None else None

    def _add(self, _name: str, health: bodies.Health) -> None:
        if self._counts.has_begun and self._supervisor.state is not RigState.OFF:
            self._counts.add(health)

    def _restart_counts(self) -> dict[str, int]:
        return {name: member.restarts.count for name, member in self._supervisor.crew.members.items()}


def _recording(health: bodies.Health | None) -> dict[str, Any] | None:
    """Return the recorder's newest counts of recorded and lost frames, with reasons."""
    if health is None or "recorded_frames" not in health.gauges:
        return None
    frames, lost = health.gauges["recorded_frames"], health.gauges["lost_frames"]
    return {"frames": int(frames), "lost": int(lost), "why": health.detail}


def _loop(loop: Loop, seconds: float) -> dict[str, Any]:
    row = msgspec.structs.asdict(loop_row(loop, seconds, kept=True))
    del row["contract_ok"]  # holds only for the last minute
    return row


def _topic(row: TopicRow) -> dict[str, Any]:
    kept = {key: getattr(row, key) for key in ("rate_hz", "drops", "superseded", "refused")}
    return {**kept, "age_p99_us": row.age_us.p99}


def machine() -> dict[str, Any]:
    """Return a description of the machine."""
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
    """Return `result` as JSON text."""
    return json.dumps(result, indent=1, allow_nan=False) + "\n"
