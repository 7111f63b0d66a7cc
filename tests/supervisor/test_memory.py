"""The supervisor keeps a minute of reports, and no more however long a rig runs."""

from __future__ import annotations

import gc
import time
import tracemalloc
from collections.abc import Iterator

import pytest

from tests.supervisor.made_up import Bench, rig
from trocar.services.supervisor.judge.state_machine import RigState
from trocar.services.supervisor.run_report import RunReport

_TURN_S = 0.05
#: Longer than any window of figures.
_FILLED_S = 75.0
#: A report is made ten times a second by each of six processes; one that stays takes more than a kilobyte.
#: A number that stays of each turn takes 13 kB.
_MORE_S, _MORE_BYTES = 20.0, 10_000


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Bench:
    """A rig whose bus has the bench's clock too, because reports that come faster than by the clock are a flood."""
    began_s = Bench.now_s
    monkeypatch.setattr(time, "monotonic_ns", lambda: round(1e9 * (made[0].now_s if made else began_s)))
    made: list[Bench] = []
    made.append(Bench(rig()))
    return made[0]


@pytest.fixture
def traced() -> Iterator[None]:
    tracemalloc.start(1)
    yield
    tracemalloc.stop()


def _bytes_after(bench: Bench, report: RunReport, seconds: float) -> int:
    for _ in range(round(seconds / _TURN_S)):
        bench.now_s += _TURN_S
        for peer in bench.peers.values():
            peer.turn(bench.now_s, _TURN_S)
        bench.supervisor.step(bench.now_s)
        report.watch_run(bench.now_s)
        bench.told()
    gc.collect()
    return tracemalloc.get_traced_memory()[0]


@pytest.mark.usefixtures("traced")
def test_the_supervisor_of_a_long_run_takes_no_more_memory(bench: Bench) -> None:
    report = RunReport(bench.supervisor)
    filled = _bytes_after(bench, report, _FILLED_S)
    assert bench.supervisor.state is RigState.RUNNING
    assert report.measured_s > _FILLED_S - 5.0
    assert _bytes_after(bench, report, _MORE_S) - filled < _MORE_BYTES
    assert bench.supervisor.state is RigState.RUNNING
