"""A report of a process: made whole, or in pieces by a loop that has no room for a whole one between two ticks."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tests.memory_bus import MemoryBus, MemoryHub
from trocar.protocol import bodies
from trocar.services.runtime.loop.loop import LoopMeter
from trocar.services.runtime.process.health import HealthReporter

MS = 1_000_000


class Loop:
    """A loop of two stages, its reporter, and who reads the reports."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_ns = 1000 * MS
        monkeypatch.setattr("trocar.services.runtime.process.health.time.monotonic_ns", lambda: self.now_ns)
        hub = MemoryHub()
        self.meter = LoopMeter(1000.0, ("first", "second"))
        self._supervisor = MemoryBus(hub, reads_every=["gateway.health"])
        self.bus = MemoryBus(hub, publishes=["gateway.health"])
        self.reporter = HealthReporter("gateway", self.bus, self.meter)

    def tick(self, n: int) -> None:
        for _ in range(n):
            self.now_ns += MS
            self.meter.start(self.now_ns, self.now_ns)
            self.meter.stages_ns = (5_000, 7_000)
            self.meter.finish(self.now_ns + 20_000)

    def reports(self) -> list[bodies.Health]:
        return [frame.body for frame in self._supervisor.drain("gateway.health")]


def _counted(report: bodies.Health) -> list[int]:
    return [int(np.sum(stage.counts.view())) for stage in report.stages]


def test_what_is_made_in_pieces_counts_each_tick_once(monkeypatch: pytest.MonkeyPatch) -> None:
    loop = Loop(monkeypatch)
    reporter = loop.reporter
    reporter.send_if_due()
    loop.reports()
    loop.tick(100)
    assert reporter.do_a_piece()
    loop.tick(1)
    assert reporter.do_a_piece(), "what is left is to be done"
    loop.tick(1)
    reporter.send_if_due()
    (report,) = loop.reports()
    assert _counted(report) == [100, 100]
    assert report.loop is not None
    assert report.loop.ticks == 101
    assert report.uptime_s == pytest.approx(0.101), "when its ticks were counted"
    loop.tick(100)
    reporter.send_if_due()
    assert [_counted(each) for each in loop.reports()] == [[202, 202]]


def test_nothing_is_begun_before_it_is_due(monkeypatch: pytest.MonkeyPatch) -> None:
    loop = Loop(monkeypatch)
    loop.reporter.send_if_due()
    loop.tick(50)
    assert not loop.reporter.do_a_piece()
    loop.reporter.send_if_due()
    assert len(loop.reports()) == 1


def test_a_change_of_state_is_told_at_once_in_the_midst_of_a_report(monkeypatch: pytest.MonkeyPatch) -> None:
    loop = Loop(monkeypatch)
    assert loop.reporter.do_a_piece()
    loop.reporter.change("degraded", "left: no drive")
    (report,) = loop.reports()
    assert (report.state, report.detail) == ("degraded", "left: no drive")
    assert not loop.reporter.do_a_piece(), "one report is due at a time"


def test_no_two_parts_of_a_report_are_made_between_the_same_two_ticks(monkeypatch: pytest.MonkeyPatch) -> None:
    """A third of a millisecond in one piece takes the next tick's time, or its budget where that is what is granted."""
    loop = Loop(monkeypatch)
    reporter, bus, done = loop.reporter, loop.bus, []
    parts = [(reporter, "_stage_costs"), (loop.meter, "body"), (bus, "reports"), (reporter, "counts"), (bus, "publish")]

    def noting(name: str, made: Callable[..., Any]) -> Callable[..., Any]:
        return lambda *said: done.append((loop.now_ns, name)) or made(*said)

    for owner, name in parts:
        monkeypatch.setattr(owner, name, noting(name, getattr(owner, name)), raising=False)
    for _ in range(250):
        loop.tick(1)
        reporter.do_a_piece()
    assert [what for _, what in done] == [name for _, name in parts] * 3
    moments = [when for when, _ in done]
    assert len(set(moments)) == len(moments)
    assert moments[5] - moments[0] == 100 * MS, "ten a second, whatever they take"
    assert len(loop.reports()) == 3


def test_a_path_that_no_rig_file_could_name_is_measured_by_nobody() -> None:
    reporter = HealthReporter("gateway", MemoryBus(MemoryHub(), publishes=["gateway.health"]))
    assert reporter.path("servo", 100_000) is reporter.path("servo", 200_000)
    with pytest.raises(KeyError, match="'servos' is no path of PATH_OWNERS"):
        reporter.path("servos", 100_000)


def test_a_flood_is_told_at_once_and_then_with_every_report(monkeypatch: pytest.MonkeyPatch) -> None:
    loop = Loop(monkeypatch)
    loop.reporter.send_if_due()
    loop.reports()
    bus = loop.bus
    monkeypatch.setattr(bus, "floods", lambda: {"haptics.contact_model": 70})
    loop.tick(3)
    loop.reporter.send_if_due()
    assert loop.reports() == [], "a report is not due"
    for _ in range(50):
        bus.on_flood()
        loop.tick(1)
        loop.reporter.send_if_due()
    (report,) = loop.reports()
    assert report.gauges["flood.haptics.contact_model"] == 70
    loop.tick(60)
    loop.reporter.send_if_due()
    assert len(loop.reports()) == 1, "as ever"
