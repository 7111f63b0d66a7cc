"""The terminal's dashboard fits a terminal."""

from __future__ import annotations

import io
from typing import Any

from rich.console import Console

from tests.memory_bus import MemoryBus, MemoryHub
from tests.supervisor.made_up import health, loop_report
from trocar import protocol
from trocar.protocol.bodies import Health, Judgement, ProcessReport, StartReport, SupervisorState
from trocar.services.cli.diagnose.top import RigSummary, render
from trocar.services.supervisor.page.rig_listener import TOPICS

LONG = {"p50": 99_999.0, "p99": 123_456.0, "p99_9": 234_567.0, "max": 345_678.0}


def _process(name: str) -> dict[str, Any]:
    loop = {"rate_hz": 1000.0, "target_hz": 1000.0, "lateness_us": LONG, "work_us": LONG, "miss_ratio": 1.0}
    return {"name": name, "state": "degraded", "pid": 99_999, "restarts": 12, "detail": "", "loop": loop}


def test_every_row_is_a_line_of_eighty_columns() -> None:
    topic = {"topic": "supervisor.health", "rate_hz": 1000.0, "target_hz": 1000.0, "drops": 30_648, "refused": {"a": 1}}
    result = {
        "state": "running", "reason": "", "quality_level": 0, "waits_for": [],
        "processes": [_process(name) for name in protocol.PROCESSES],
        "paths": dict.fromkeys(("device_model", "device_force", "device_pixel"), LONG),
        "topics": [{**topic, "topic": name, "age_us": LONG} for name in protocol.TOPICS],
    }  # fmt: skip
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(render(result))
    lines = console.export_text().splitlines()
    assert len(lines) == 2 + (1 + len(protocol.PROCESSES)) + (1 + 3) + (1 + len(protocol.TOPICS)), "no row is wrapped"
    assert max(map(len, lines)) <= 80
    assert not any("\u2026" in line for line in lines), "nothing is cut"


def _shown(summary: RigSummary) -> str:
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(render(summary.result(1.0)))
    return console.export_text()


def test_what_is_known_is_shown_at_once_and_what_it_waits_for() -> None:
    hub = MemoryHub()
    bus = MemoryBus(hub, reads=TOPICS)
    said = MemoryBus(hub, publishes=["gateway.health", "supervisor.state", "supervisor.judgement"])
    summary = RigSummary(bus, 2.0, {"gateway": 17, "physics": 18})
    assert summary.is_anybody(), "locks tell that somebody runs before he has said a word"
    summary.hear(1.0)
    text = _shown(summary)
    assert "waiting for the supervisor's judgement, gateway (running), physics (running)" in text
    assert "no word from the supervisor" in text

    said.publish("gateway.health", Health(process="gateway", pid=17, state="running", uptime_s=3.0))
    summary.hear(1.0)
    assert summary.result(1.0)["waits_for"] == ["the supervisor's judgement", "physics (running)"]

    reports = (
        ProcessReport(name="gateway", state="ready", pid=17, restarts=2),
        ProcessReport(name="physics", state="starting", pid=18),
        ProcessReport(name="recorder", state="failed", reason="recorder: the disk is full"),
    )
    said.publish("supervisor.state", SupervisorState(state="starting", processes=reports))
    summary.hear(1.0)
    result = summary.result(1.0)
    assert result["waits_for"] == ["physics (starting)"], "who was given up is not waited for"
    compiles = StartReport(process="physics", stage="kernels", fraction=0.4)
    said.publish("supervisor.judgement", Judgement(incarnation=1, t=2.0, starts=(compiles,)))
    summary.hear(1.0)
    assert summary.result(1.0)["waits_for"] == ["physics (kernels, 40 %)"]
    rows = {row["name"]: (row["state"], row["restarts"], row["detail"]) for row in result["processes"]}
    assert rows == {
        "gateway": ("running", 2, ""),
        "physics": ("starting", 0, ""),
        "recorder": ("failed", 0, "recorder: the disk is full"),
    }


def test_a_broken_contract_is_told_and_who_calls_himself_otherwise_is_shown_by_his_topic() -> None:
    hub = MemoryHub()
    said = MemoryBus(hub, publishes=["physics.health", "supervisor.judgement"])
    bus = MemoryBus(hub, reads=TOPICS)
    summary = RigSummary(bus, 2.0, {})
    said.publish("supervisor.judgement", Judgement(incarnation=1, t=2.0, broken=("physics ticks",)))
    for ticks in (1000, 2000):
        said.publish("physics.health", health("nobody", uptime_s=1e-3 * ticks, loop=loop_report(ticks)))
        summary.hear(1.0)
    (row,) = summary.result(1.0)["processes"]
    assert (row["name"], row["loop"]["contract_ok"]) == ("physics", False)


def test_nobody_is_nobody() -> None:
    bus = MemoryBus(MemoryHub(), reads=TOPICS)
    assert not RigSummary(bus, 2.0, {}).is_anybody()
