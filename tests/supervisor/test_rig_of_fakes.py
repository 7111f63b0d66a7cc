"""Real processes, tiny ones, on the real bus: started, killed, stopped, started again, ended."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from tests.real_time import fifo_is_granted
from tests.supervisor.fakes import Fakes, Scenario, gone, page_servers, until, until_running
from trocar.services.runtime.errors import BusError
from trocar.services.supervisor import session
from trocar.services.supervisor.control.supervisor import Supervisor
from trocar.services.supervisor.crew.fork_link import ForkServer
from trocar.services.supervisor.crew.member import MemberState
from trocar.services.supervisor.judge.state_machine import RigState
from trocar.services.supervisor.page.page import Page


@pytest.fixture
def fakes(fakes: Fakes, server: ForkServer, soon: None, pageless: None) -> Fakes:
    return replace(fakes, fork_server=server)


@pytest.fixture
def with_page(pageless: None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session, "Page", Page)


def test_start_order_progress_no_second_rig_and_a_clean_end(fakes: Fakes) -> None:
    pids: list[int] = []
    progress: dict[str, tuple[str, float] | None] = {}

    def scenario(supervisor: Supervisor) -> Scenario:
        yield from until_running(supervisor)
        pids.extend(member.pid for member in supervisor.crew.members.values())
        progress.update({name: member.progress for name, member in supervisor.crew.members.items()})
        with pytest.raises(BusError, match=r"a rig is running here already: .* `trocar down` ends it"):
            session.open_session(fakes.options)

    events = fakes.play(scenario)
    assert len(set(pids)) == 6
    assert all(gone(pid) for pid in pids)
    assert progress["physics"] == ("building what a fake needs", 0.5)
    started = [event.split(":")[0] for event in events if "started as process" in event]
    assert set(started[:3]) == {"physics", "haptics", "recorder"}
    assert set(started[3:]) == {
        "gateway",
        "visualization",
        "training",
    }  # they wait until haptics says that it has prepared


@pytest.mark.parametrize("command", [["-m", "trocar.services.supervisor"], ["-m", "trocar.services.cli.app", "up"]])
def test_too_few_descriptors_are_a_sentence_before_anything_starts(command: list[str], tmp_path: Path) -> None:
    least = ["bash", "-c", 'ulimit -n 64; exec "$@"', "-", sys.executable, *command]
    environment = os.environ | {"TMPDIR": str(tmp_path), "XDG_RUNTIME_DIR": str(tmp_path)}
    ended = subprocess.run(least, env=environment, capture_output=True, text=True, timeout=100, check=False)
    assert ended.returncode == 1
    assert ended.stderr.count("\n") == 1
    assert "only 64 files may be open at once, a rig needs 2" in ended.stderr
    assert list(tmp_path.iterdir()) == []


def test_a_rig_whose_place_for_flights_is_taken_by_somebody_runs_and_ends_all_the_same(
    fakes: Fakes, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """In ``/dev/shm`` another user may have been there first: nothing can be looked at, nothing is to be removed."""
    (tmp_path / f"trocar-{os.getuid()}").mkdir()
    (tmp_path / f"trocar-{os.getuid()}").chmod(0o777)
    monkeypatch.setattr("trocar.services.runtime.measures.flight.MEMORY", tmp_path)
    monkeypatch.setattr("trocar.services.runtime.measures.flight.is_memory", lambda _directory: False)
    fakes.play(until_running)


def test_killed_or_stopped_is_noticed_and_started_again(fakes: Fakes) -> None:
    def scenario(supervisor: Supervisor) -> Scenario:
        for name, number in (("haptics", signal.SIGKILL), ("physics", signal.SIGSTOP)):
            yield from until_running(supervisor)
            member = supervisor.crew.members[name]
            others = {n: m.pid for n, m in supervisor.crew.members.items() if n != name}
            first = member.pid
            os.kill(first, number)
            yield from until(lambda name=name: supervisor.state is RigState.DEGRADED and name in supervisor.reason)
            yield from until(lambda member=member, first=first: member.up and member.pid != first)
            yield from until_running(supervisor)
            assert member.restarts.count == 1
            assert {n: m.pid for n, m in supervisor.crew.members.items() if n != name} == others
            assert not supervisor.body().safe_stop

    fakes.play(scenario)


def test_a_recorder_whose_disk_is_full_is_given_up_the_rig_goes_on_and_its_end_tells(fakes: Fakes) -> None:
    """Picture and forces do not depend on a disk; who waits for the rig to end learns of it by the exit code."""

    def scenario(supervisor: Supervisor) -> Scenario:
        recorder = supervisor.crew.members["recorder"]
        yield from until(lambda: supervisor.crew.all_ready)
        before = {name: member.pid for name, member in supervisor.crew.members.items() if member is not recorder}
        yield from until(lambda: recorder.state is MemberState.FAILED)
        for _ in range(25):
            yield
        assert {n: m.pid for n, m in supervisor.crew.members.items() if m is not recorder} == before
        assert all(member.up for member in supervisor.crew.members.values() if member is not recorder)
        assert not supervisor.body().safe_stop
        assert recorder.restarts.count == 0, "its disk would be as full, and a file more on it"
        assert "records again when there is room and the rig is armed" in recorder.reason

    with pytest.raises(session.GivenUpError, match=r"a\.mcap: no space left on device; 200 frames were kept") as caught:
        fakes.play(scenario, recorder="full")
    assert caught.value.exit_code == 5


def test_a_recorder_whose_disk_is_full_is_told_of_however_soon_the_rig_ends(fakes: Fakes) -> None:

    def scenario(supervisor: Supervisor) -> Scenario:
        recorder = supervisor.crew.members["recorder"]
        yield from until(lambda: recorder.state is MemberState.FAILED)

    with pytest.raises(session.GivenUpError, match=r"a\.mcap: no space left on device; 200 frames were kept") as caught:
        fakes.play(scenario, recorder="full")
    assert caught.value.exit_code == 5


@pytest.mark.parametrize(
    ("number", "how"), [(signal.SIGKILL, ": ended by SIGKILL"), (signal.SIGSTOP, r"(: .* is stopped|\.health: silent)")]
)
def test_a_recorder_that_a_signal_ended_or_stopped_leaves_a_hole_that_the_end_tells_of(
    fakes: Fakes, number: int, how: str
) -> None:
    def scenario(supervisor: Supervisor) -> Scenario:
        yield from until_running(supervisor)
        recorder = supervisor.crew.members["recorder"]
        first = recorder.pid
        os.kill(first, number)
        yield from until(lambda: recorder.up and recorder.pid != first)

    with pytest.raises(session.GivenUpError, match=rf"^recorder{how}.*; the recording has a hole$") as caught:
        fakes.play(scenario)
    assert caught.value.exit_code == 7


def test_what_a_process_could_not_do_at_its_end_is_told(fakes: Fakes) -> None:
    """The last that a recorder writes may be what the disk has no room for."""
    with pytest.raises(session.GivenUpError, match=r"a\.mcap: no space left on device; 100 frames were kept") as caught:
        fakes.play(until_running, recorder="full_at_last")
    assert caught.value.exit_code == 5


def test_a_window_that_a_person_closes_ends_the_rig_in_good_order(fakes: Fakes) -> None:
    def scenario(supervisor: Supervisor) -> Scenario:
        yield from until_running(supervisor)
        yield from until(lambda: False)  # the session ends by itself

    events = fakes.play(scenario, visualization="closed")
    assert "visualization: a person has ended the rig there" in events
    assert not any("restarted" in event or "killed" in event for event in events)


def test_too_many_restarts_are_a_safe_stop_until_armed(fakes: Fakes) -> None:
    def scenario(supervisor: Supervisor) -> Scenario:
        yield from until_running(supervisor)
        physics = supervisor.crew.members["physics"]
        for _ in range(3):  # the limit of this rig is two a minute
            yield from until(lambda: physics.child is not None)
            pid = physics.pid
            physics.kill()
            yield from until(lambda pid=pid: physics.pid != pid)
        yield from until(lambda: supervisor.state is RigState.SAFE_STOP)
        assert physics.state is MemberState.FAILED
        assert "physics: ended by SIGKILL; restarted too often within a minute" in supervisor.reason
        assert supervisor.body().safe_stop
        supervisor.arm("the test")
        yield from until_running(supervisor)

    fakes.play(scenario)


def test_a_process_that_cannot_start_ends_the_rig_with_its_sentence(fakes: Fakes) -> None:
    pids: list[int] = []

    def scenario(supervisor: Supervisor) -> Scenario:
        while True:
            pids.extend(m.pid for m in supervisor.crew.members.values() if m.pid)
            yield

    with pytest.raises(session.StartError, match=r"^haptics: configs/made_up.yaml: this key is missing$") as told:
        fakes.play(scenario, haptics="exit")
    assert told.value.exit_code == 2
    assert pids
    assert all(gone(pid) for pid in set(pids))


@pytest.mark.skipif(not fifo_is_granted(), reason="this system refuses SCHED_FIFO")
@pytest.mark.usefixtures("with_page")
def test_it_judges_in_real_time_and_what_it_starts_is_ordinary(fakes: Fakes) -> None:
    with open(fakes.options.rig, "a") as file:
        file.write("processes: {supervisor: {priority: 10}}\n")
    had: dict[str, int] = {}

    def scenario(supervisor: Supervisor) -> Scenario:
        yield from until_running(supervisor)
        had["judge"] = os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK
        had.update({name: os.sched_getscheduler(member.pid) for name, member in supervisor.crew.members.items()})
        had["page"] = next(os.sched_getscheduler(pid) for pid in page_servers())

    kept = os.sched_getscheduler(0)
    try:
        replace(fakes, fork_server=None).play(scenario)
    finally:
        os.sched_setscheduler(0, kept, os.sched_param(0))
    assert had.pop("judge") == os.SCHED_FIFO
    assert set(had.values()) == {os.SCHED_OTHER}


def test_a_start_that_a_person_interrupts_is_told_apart_from_a_run(fakes: Fakes) -> None:
    def interrupt(supervisor: Supervisor) -> Scenario:
        os.kill(os.getpid(), signal.SIGTERM)
        yield from until(lambda: supervisor.state is RigState.RUNNING)

    with pytest.raises(session.InterruptedStartError, match="before it ran") as told:
        fakes.play(interrupt)
    assert told.value.exit_code == 8

    def run(supervisor: Supervisor) -> Scenario:
        yield from until_running(supervisor)
        os.kill(os.getpid(), signal.SIGTERM)
        yield from until(lambda: False)

    assert fakes.play(run)
