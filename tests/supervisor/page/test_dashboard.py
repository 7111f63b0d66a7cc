"""What the page is sent: the agreed keys, finite numbers or null."""

from __future__ import annotations

import json
from typing import Any

import msgspec
import pytest

import trocar.protocol.bodies as bodies
from tests.supervisor.made_up import Bench, health, histogram, loop_report, rig, shown
from trocar.services.supervisor.page.dashboard import Heard

ROW = {
    "name",
    "state",
    "pid",
    "restarts",
    "uptime_s",
    "reason",
    "loop",
    "realtime",
    "stages",
    "gauges",
    "quality_level",
}
LOOP = {
    "rate_hz", "target_hz", "ticks", "misses", "miss_ratio", "skipped", "lateness_us", "work_us", "contract_ok",
}  # fmt: skip
TOPIC = {"topic", "publisher", "rate_hz", "target_hz", "age_us", "drops", "superseded", "refused"}
SPREAD = {"p50", "p99", "p99_9", "max"}


def _strict(text: bytes) -> Any:
    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is not JSON")

    return json.loads(text, parse_constant=refuse)


def _shown(bench: Bench) -> Any:
    return _strict(msgspec.json.encode(shown(bench)))


def test_nothing_heard_yet_is_null_not_nan() -> None:
    shown = _shown(Bench(rig()))
    assert shown["state"] == "off"
    assert shown["answered_next_tick"] is None
    assert [row["loop"] for row in shown["processes"]] == [None] * 6


def test_how_late_the_supervisor_judged_is_shown() -> None:
    """Lately, and since it began: a turn of 30 ms is in the first report only."""
    bench = Bench(rig())
    assert _shown(bench)["judge"] is None
    late, now = bench.heard.setdefault("supervisor", Heard(2.0)), loop_report(50)
    for k, lateness_ns in enumerate([[30_000_000], [30_000_000, 400_000, 500_000]]):
        body = msgspec.structs.replace(now, ticks=50 + 50 * k, lateness=histogram(lateness_ns))
        late.take_report(health("supervisor", uptime_s=50.0 + k, loop=body))
    judge = _shown(bench)["judge"]
    assert judge["rate_hz"] == pytest.approx(50.0)
    assert 480 < judge["lateness_us"]["max"] < 525
    assert judge["latest_us"] == pytest.approx(30_000.0)


def test_the_agreed_keys() -> None:
    bench = Bench(rig(contracts={"paths": {"device_model": {"p99_us": 800}}}))
    bench.run(3.0)
    gateway = bench.supervisor.crew.members["gateway"]
    topic = bodies.TopicReport(topic="haptics.contact_model", received=9, age=histogram([90_000] * 9))
    for k in range(2):
        path = bodies.PathLatency(
            name="device_model", latency=histogram([400_000] * (100 + 200 * k)), answered=99 * k, asked=100 * k
        )
        body = health(
            "gateway", uptime_s=50.0 + k, loop=loop_report(1000 * k), paths=(path,), topics=(topic,), pid=gateway.pid
        )
        bench.heard["gateway"].take_report(body)
    shown = _shown(bench)
    assert {"t", "state", "reason", "quality_level", "safe_stop", "rig", "scene", "heat", "events"} <= shown.keys()
    assert len(shown["processes"]) == 6
    for row in shown["processes"]:
        assert row.keys() >= ROW
        assert row["loop"].keys() == LOOP
        assert row["loop"]["lateness_us"].keys() == SPREAD
    assert shown["topics"]
    for row in shown["topics"]:
        assert row.keys() == TOPIC
    (path_row,) = shown["paths"]
    assert path_row.keys() == {"name", "limit_p99", "ok"} | SPREAD
    assert path_row["limit_p99"] == 800
    assert 370 < path_row["p50"] < 430
    assert shown["answered_next_tick"] == 0.99
    physics = next(row for row in shown["processes"] if row["name"] == "physics")
    assert physics["state"] == "ready"
    assert physics["loop"]["rate_hz"] == pytest.approx(1000.0, rel=0.01)
    assert physics["loop"]["contract_ok"]
    heat = shown["heat"]["gateway"]
    assert len(heat["counts"]) == len(heat["edges_us"]) + 1
    assert 1000.0 in heat["edges_us"]
