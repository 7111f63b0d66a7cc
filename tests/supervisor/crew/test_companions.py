"""The supervisor's companions are judged as the rest: one that is silent, or has ended, is said and started again."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from tests.by_day import by_day
from tests.patience import PATIENCE_S
from tests.supervisor.fakes import Fakes, Scenario, page_servers, until, until_running
from trocar.services.supervisor.control.supervisor import Supervisor
from trocar.services.supervisor.diagnosis import lateness_floor
from trocar.services.supervisor.diagnosis.lateness_floor import LatenessFloor
from trocar.services.supervisor.diagnosis.observer import RigSight

pytestmark = pytest.mark.usefixtures("soon")


@pytest.mark.parametrize(
    ("number", "stopped_s", "said"),
    by_day(
        [(signal.SIGSTOP, 0.1, "is stopped by a signal"), (signal.SIGSTOP, 60.0, "said nothing for")],
        [(signal.SIGKILL, 0.1, "ended")],
    ),
)
def test_a_page_that_hangs_or_ends_is_started_again(
    fakes: Fakes, monkeypatch: pytest.MonkeyPatch, number: signal.Signals, stopped_s: float, said: str
) -> None:
    monkeypatch.setattr("trocar.services.supervisor.page.page._SILENT_S", 1.0)
    monkeypatch.setattr("trocar.services.supervisor.crew.silence._STOPPED_S", stopped_s)

    def scenario(supervisor: Supervisor) -> Scenario:
        yield from until_running(supervisor)
        (first,) = page_servers()
        yield from until(lambda: _has_beaten(first))
        os.kill(first, number)
        yield from until(lambda: any(f"the page's process {said}" in event.text for event in supervisor.events))
        yield from until(lambda: page_servers() not in ([], [first]))
        assert all(member.restarts.count == 0 for member in supervisor.crew.members.values()), "the rig goes on"

    fakes.play(scenario)


def _has_beaten(pid: int) -> bool:
    """Return whether a page serves by now: it has started the floor's watcher."""
    return Path(f"/proc/{pid}/task/{pid}/children").read_text() != ""


@pytest.fixture
def floor(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[LatenessFloor]:
    tmp_path.chmod(0o700)
    monkeypatch.setattr(lateness_floor, "_SILENT_S", 0.5)
    with closing(LatenessFloor(tmp_path)) as made:
        yield made


@pytest.mark.parametrize(("number", "said"), [(signal.SIGKILL, "ended"), (signal.SIGSTOP, "hangs")])
def test_a_watcher_of_the_floor_that_hangs_or_ends_is_started_again(
    floor: LatenessFloor, number: signal.Signals, said: str
) -> None:
    def watch(done: str) -> None:
        end_s = time.monotonic() + PATIENCE_S
        while floor.said != done or not floor.report():
            assert time.monotonic() < end_s
            floor.sample(RigSight(time.monotonic()))
            time.sleep(0.05)

    monotonic = time.monotonic() + PATIENCE_S
    while not floor.report() and time.monotonic() < monotonic:
        floor.sample(RigSight(0.0))
        time.sleep(0.05)
    first: subprocess.Popen[bytes] = floor._process
    first.send_signal(number)
    watch(f"the floor's watcher {said}: started again")
    assert floor._process.pid != first.pid
    assert first.poll() is not None
