"""``trocar diagnose top``: the rig in a terminal, straight from the bus, also without page and supervisor."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import msgspec
from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

import trocar.protocol.bodies as bodies
from trocar.protocol.topics import HEALTH_S, HEARTBEAT_S
from trocar.services.runtime.bus.bus import Bus
from trocar.services.runtime.bus.endpoints import lock_holders
from trocar.services.runtime.bus.zmq_bus import ZmqBus
from trocar.services.runtime.config import config
from trocar.services.runtime.errors import BusError
from trocar.services.runtime.measures.histogram import Quantiles
from trocar.services.supervisor.page.dashboard import loop_row, topic_rows
from trocar.services.supervisor.page.rig_listener import TOPICS, RigListener

_TURN_S = HEALTH_S
_STALE_S = 2 * HEARTBEAT_S  # twice, as this process is of the ordinary class and hears late on a busy machine
_QUANTILES = tuple(field.name for field in fields(Quantiles))
#: Of a terminal as it is opened; all tables fit.
_WIDTH = 80


class RigSummary:
    """What is heard of a rig, as plain data; `running` are ids of processes that are known to run before they speak."""

    def __init__(self, bus: Bus, window_s: float, running: Mapping[str, int]) -> None:
        self._bus = bus
        self._rig = RigListener(window_s)
        self._running = running

    def hear(self, now_s: float) -> None:
        """Take what has arrived."""
        self._rig.hear_all(self._bus, now_s)

    def is_anybody(self) -> bool:
        """Return whether somebody was heard, or is known to run: it may be compiling, which it does in silence."""
        return bool(self._rig.reports or self._running)

    def result(self, now_s: float) -> dict[str, Any]:
        """Return what was heard as plain data, NaN as None."""
        state, counted, unheard = self._rig.state, self._rig.figures(), self._unheard()
        waits = [] if state else ["the supervisor's judgement"]
        doing = self._rig.starts
        waits += [f"{n} ({doing.get(n, report.state)})" for n, report in unheard.items() if report.state != "failed"]
        processes = [self._heard_row(name, health, now_s) for name, health in self._rig.reports.items()]
        data = {
            "state": state.state if state else "unknown",
            "reason": state.reason if state else "no word from the supervisor",
            "quality_level": state.quality_level if state else None,
            "waits_for": waits,
            "processes": processes + [_unheard_row(report) for report in unheard.values()],
            "paths": {n: p.latency.quantiles() for w in counted.values() for n, p in w.paths.items()},
            "topics": topic_rows(counted),
        }
        plain: dict[str, Any] = json.loads(msgspec.json.encode(data))
        return plain

    def _unheard(self) -> dict[str, bodies.ProcessReport]:
        """Return who has said nothing yet: as the supervisor knows it, else as the lock of its endpoints tells."""
        known = {name: bodies.ProcessReport(name=name, state="running", pid=pid) for name, pid in self._running.items()}
        known |= {report.name: report for report in self._said()}
        return {name: report for name, report in known.items() if name not in self._rig.reports}

    def _said(self) -> tuple[bodies.ProcessReport, ...]:
        """Return what the supervisor says of the processes."""
        return self._rig.state.processes if self._rig.state is not None else ()

    def _heard_row(self, name: str, health: bodies.Health, now_s: float) -> dict[str, Any]:
        heard = self._rig.heard[name]
        window, is_kept = heard.figures, f"{name} ticks" not in self._rig.broken
        return {
            "name": name,
            "state": health.state if now_s - heard.heard_s < _STALE_S else "silent",
            "pid": health.pid,
            "restarts": next((report.restarts for report in self._said() if report.name == name), 0),
            "detail": health.detail,
            "loop": loop_row(window.loop, window.seconds, is_kept) if window.loop else None,
        }


def _unheard_row(report: bodies.ProcessReport) -> dict[str, Any]:
    return {
        "name": report.name, "state": report.state, "pid": report.pid, "restarts": report.restarts,
        "detail": report.reason, "loop": None,
    }  # fmt: skip


def run_top(rig: str, once: bool, as_json: bool, seconds: float, overrides: tuple[str, ...]) -> None:
    """Show the rig until Ctrl-C, or once. Raises BusError if nobody is heard."""
    transport = config.load_rig(rig, overrides).transport
    bus = ZmqBus(transport, reads=TOPICS)
    try:
        summary = RigSummary(bus, seconds, lock_holders(transport))
        if once or not summary.is_anybody():
            _listen(summary, seconds if once else 0.5)
        if not summary.is_anybody():
            raise BusError("nothing was heard: is a rig running on this transport?")
        if once:
            _print_once(summary, as_json=as_json)
        else:
            _follow(summary, as_json=as_json)
    except KeyboardInterrupt:
        return
    finally:
        bus.close()


def _listen(summary: RigSummary, seconds: float) -> None:
    until_s = time.monotonic() + seconds
    while time.monotonic() < until_s:
        summary.hear(time.monotonic())
        time.sleep(_TURN_S)


def _print_once(summary: RigSummary, *, as_json: bool) -> None:
    result = summary.result(time.monotonic())
    if as_json:
        print(json.dumps(result, indent=1))
    else:
        console = Console(highlight=False)
        console.print(render(result), width=None if console.is_terminal else _WIDTH)


def _follow(summary: RigSummary, *, as_json: bool) -> None:
    if as_json:
        while True:
            _listen(summary, 1.0)
            print(json.dumps(summary.result(time.monotonic())), flush=True)
    with Live(auto_refresh=False) as live:
        while True:
            result = summary.result(time.monotonic())
            live.update(render(result), refresh=True)
            _listen(summary, _TURN_S if result["waits_for"] else 0.5)  # who is awaited is shown when he is heard


def render(result: dict[str, Any]) -> Group:
    """Return the tables of a result, above them whom it waits for."""
    head = Text(f"rig {result['state']}  quality level {result['quality_level']}  {result['reason']}")
    waits = [Text(f"waiting for {', '.join(result['waits_for'])}", style="yellow")] if result["waits_for"] else []
    what = Text("late: p50, p99 and max of a tick's start; work: its p99; us", style="dim")
    return Group(
        head,
        *waits,
        what,
        _process_table(result["processes"]),
        _path_table(result["paths"]),
        _topic_table(result["topics"]),
    )


def _process_table(processes: list[dict[str, Any]]) -> Table:
    table = _table(
        "process", "state", "Hz", "target", "late", "p99", "max", "work", "missed", "restarts", first_width=13
    )
    for row in processes:
        loop = row["loop"] or {}
        late, work = loop.get("lateness_us") or {}, loop.get("work_us") or {}
        cells = (_number(loop.get("rate_hz")), _number(loop.get("target_hz")))
        spreads = (
            _number(late.get("p50")),
            _number(late.get("p99")),
            _number(late.get("max")),
            _number(work.get("p99")),
        )
        missed = "" if loop.get("miss_ratio") is None else f"{100 * loop['miss_ratio']:.2f} %"
        table.add_row(row["name"], row["state"], *cells, *spreads, missed, str(row["restarts"]))
    return table


def _path_table(paths: dict[str, dict[str, float]]) -> Table:
    table = _table("path us", *_QUANTILES)
    for name, values in paths.items():
        table.add_row(name, *(_number(values[key]) for key in _QUANTILES))
    return table


def _topic_table(topics: list[dict[str, Any]]) -> Table:
    table = _table("topic", "Hz", "target", "age p99 us", "drops", "refused")
    for row in topics:
        refused = sum(row["refused"].values())
        age = _number(row["age_us"]["p99"])
        numbers = (_number(row["rate_hz"]), _number(row["target_hz"]), age, str(row["drops"]), str(refused))
        table.add_row(row["topic"], *numbers)
    return table


def _table(first: str, *others: str, first_width: int = 22) -> Table:
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column(first, min_width=first_width)
    for title in others:
        table.add_column(title, justify="left" if title == "state" else "right")
    return table


def _number(value: float | None) -> str:
    if value is None:
        return ""
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.1f}"
