"""Real processes, tiny ones, on the real bus: started, killed, stopped, started again, ended."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import httpx
import pytest

from services.runtime import config
from services.runtime.errors import BusError
from services.runtime.process import Options
from services.runtime.zmq_bus import ZmqBus
from services.supervisor import page, run_report, session
from services.supervisor.member import MemberState
from services.supervisor.nursery import Nursery
from services.supervisor.processes import TABLE, ProcessSpec
from services.supervisor.state_machine import RigState
from services.supervisor.supervisor import Supervisor
from tests.real_time import fifo_is_granted
from tests.with_us import with_us

pytestmark = pytest.mark.rig


HERE = Path(__file__).parent
PATIENCE_S = 120.0
Scenario = Iterator[None]


@dataclass
class Fakes:
    """A rig of fake processes in a folder of its own."""

    options: Options
    nursery: Nursery | None = None

    def table(self, **words: str) -> tuple[ProcessSpec, ...]:
        path = os.pathsep.join((str(HERE), str(HERE.parents[1])))
        return tuple(
            replace(
                spec,
                module="fake_process",
                environment={
                    **spec.environment, "PYTHONPATH": path, "FAKE_NAME": spec.name,
                    "FAKE_WORDS": words.get(spec.name, ""),
                },
            )
            for spec in TABLE
        )  # fmt: skip

    def play(self, scenario: Callable[[Supervisor], Scenario], **words: str) -> list[str]:
        """Run the rig for as long as the scenario lasts; return the events."""
        table = self.table(**words)
        events: list[str] = []
        playing: list[Scenario] = []

        def turn(supervisor: Supervisor, _now_s: float) -> bool:
            if not playing:
                playing.append(scenario(supervisor))
            return next(playing[0], "end") == "end"

        process = session.open_session(self.options)
        try:
            options = session.SessionOptions(
                self.options, table, lambda event: events.append(event.text), turn, nursery=self.nursery
            )
            session.run_session(process, options)
        finally:
            process.bus.close()
        return events


@pytest.fixture
def fakes(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Fakes]:
    folder = tmp_path_factory.mktemp("rig")
    file = folder / "fakes.yaml"
    file.write_text(
        f"name: fakes\ntransport: {{directory: {folder}}}\n"
        "supervisor: {web: {port: 0}, max_restarts_per_minute: 2}\n"
    )
    kept = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)}
    yield Fakes(Options(str(file), None, ()))
    for number, handler in kept.items():
        signal.signal(number, handler)


def until(condition: Callable[[], bool], patience_s: float = 120.0) -> Scenario:
    deadline = time.monotonic() + patience_s
    while not condition():
        assert time.monotonic() < deadline, "it did not happen"
        yield


def until_running(supervisor: Supervisor) -> Scenario:
    yield from until(lambda: supervisor.state is RigState.RUNNING)


def gone(pid: int) -> bool:
    return not Path(f"/proc/{pid}").exists()


def test_who_looks_at_processes_that_others_start_keeps_no_zygote(fakes: Fakes) -> None:
    fakes.options = replace(fakes.options, overrides=("supervisor.mode=attach",))
    with Nursery() as nursery:
        fakes.nursery = nursery
        fakes.play(lambda _supervisor: iter([None]))
        assert nursery.lost
        assert gone(nursery.pid)


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
    assert len(set(pids)) == 5
    assert all(gone(pid) for pid in pids)
    assert progress["physics"] == ("building what a fake needs", 0.5)
    started = [event.split(":")[0] for event in events if "started as process" in event]
    assert set(started[:3]) == {"physics", "haptics", "recorder"}
    assert set(started[3:]) == {
        "gateway",
        "visualization",
    }  # they wait until haptics and physics say that they are ready


def test_a_rig_whose_place_for_flights_is_taken_by_somebody_runs_and_ends_all_the_same(
    fakes: Fakes, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """In ``/dev/shm`` another user may have been there first: nothing can be looked at, nothing is to be removed."""
    (tmp_path / f"trocar-{os.getuid()}").mkdir()
    (tmp_path / f"trocar-{os.getuid()}").chmod(0o777)
    monkeypatch.setattr("services.runtime.flight._MEMORY", tmp_path)
    monkeypatch.setattr("services.runtime.flight.is_memory", lambda _directory: False)
    fakes.play(until_running)


def test_who_dies_is_born_anew_and_started_anew_where_nobody_bears_any_more(
    fakes: Fakes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join((str(HERE), str(HERE.parents[1]))))
    born, pids = [], []

    def struck(supervisor: Supervisor) -> Scenario:
        member = supervisor.crew.members["haptics"]
        first = member.pid
        os.kill(first, signal.SIGKILL)
        yield from until(lambda: member.up and member.pid != first)
        yield from until_running(supervisor)
        assert gone(first)
        pids.append(member.pid)

    def scenario(supervisor: Supervisor) -> Scenario:
        yield from until_running(supervisor)
        born.extend(_is_born(member.pid) for member in supervisor.crew.members.values())
        yield from struck(supervisor)
        born.append(_is_born(pids[-1]))
        os.kill(nursery.pid, signal.SIGKILL)
        yield from struck(supervisor)
        born.append(_is_born(pids[-1]))
        pids.extend(member.pid for member in supervisor.crew.members.values())

    with Nursery() as nursery:
        events = replace(fakes, nursery=nursery).play(scenario)
    assert born == [True] * 6 + [False]
    assert all(gone(pid) for pid in pids)
    assert sum(event.startswith("haptics: ended by SIGKILL") for event in events) == 2


def test_who_is_born_while_the_rig_ends_is_ended_too(fakes: Fakes, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join((str(HERE), str(HERE.parents[1]))))

    def scenario(supervisor: Supervisor) -> Scenario:
        yield from until(lambda: any(member.birth is not None for member in supervisor.crew.members.values()))

    with Nursery() as nursery:
        events = replace(fakes, nursery=nursery).play(scenario)
    assert any("started as process" in event for event in events), "as was asked for before"
    assert _children("fake_process") == []


def _is_born(pid: int) -> bool:
    """Return whether a process is a copy of one that had more room for its command line."""
    return Path(f"/proc/{pid}/cmdline").read_bytes().endswith(b"\0\0")


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
    fakes = replace(fakes, options=replace(fakes.options, overrides=("supervisor.max_restarts_per_minute=0",)))

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

    with pytest.raises(session.GivenUpError, match=r"a\.mcap: no space left on device; 200 frames were kept") as caught:
        fakes.play(scenario, recorder="full")
    assert caught.value.exit_code == 5


def test_a_recorder_whose_disk_is_full_is_told_of_however_soon_the_rig_ends(fakes: Fakes) -> None:
    """Started again, it may well be ready and not given up yet: the recording has a hole all the same."""

    def scenario(supervisor: Supervisor) -> Scenario:
        recorder = supervisor.crew.members["recorder"]
        yield from until(lambda: recorder.restarts.count > 0 and recorder.up)

    with pytest.raises(session.GivenUpError, match=r"a\.mcap: no space left on device; 200 frames were kept") as caught:
        fakes.play(scenario, recorder="full")
    assert caught.value.exit_code == 5


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


def test_report_counts_the_running_time_only(fakes: Fakes, tmp_path: Path) -> None:
    report: list[run_report.RunReport] = []

    def scenario(supervisor: Supervisor) -> Scenario:
        report.append(run_report.RunReport(supervisor))
        while report[0].measured_s < 0.5:
            report[0].turn(time.monotonic())
            yield
        os.kill(supervisor.crew.members["haptics"].pid, signal.SIGKILL)
        while report[0].measured_s < 3.0:
            report[0].turn(time.monotonic())
            yield

    fakes.play(scenario, recorder="slow")
    result = json.loads(run_report.as_text(report[0].result()))
    assert result.keys() >= {"loops", "paths", "answered_next_tick", "topics", "restarts", "realtime", "machine"}
    (stay,) = result["rungs"]
    assert stay["level"] == 0
    assert stay["loops"]["gateway"]["ticks"] == result["loops"]["gateway"]["ticks"]
    assert result["restarts"] == {"gateway": 0, "physics": 0, "haptics": 1, "visualization": 0, "recorder": 0}
    gateway, slow = result["loops"]["gateway"], result["loops"]["recorder"]
    assert gateway.keys() >= {"rate_hz", "ticks", "misses", "miss_ratio", "lateness_us", "work_us"}
    assert gateway["lateness_us"].keys() == {"p50", "p99", "p99_9", "max"}
    # 200 Hz over three seconds, give or take a report at either end, or however long the machine kept one back; what
    # came before RUNNING is not in it.
    due = gateway["ticks"] + gateway["skipped"]
    assert 200 * 3 - 150 < due < 200 * report[0].measured_s + 150
    assert due / (gateway["ticks"] / gateway["rate_hz"]) == pytest.approx(200, rel=0.05)
    assert slow["miss_ratio"] > 0.2
    assert slow["work_us"]["p99"] > 5000
    own = result["supervisor"]["lateness_us"]
    assert 0.0 < own["p50"] <= own["p99"] <= own["max"]
    # A frame a tick, however many the machine left it; the frames of the last report are not all of the same ticks.
    assert result["topics"]["gateway.state"]["rate_hz"] == pytest.approx(gateway["rate_hz"], rel=0.05)
    assert any(fact["name"] == "scheduling" for fact in result["realtime"]["gateway"])


def test_a_process_that_does_not_end_is_killed_and_counts_no_longer(
    fakes: Fakes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("services.supervisor.crew.END_S", 1.5)
    report: list[run_report.RunReport] = []
    pids: list[int] = []
    asked_to_end_s: list[float] = []

    def scenario(supervisor: Supervisor) -> Scenario:
        report.append(run_report.RunReport(supervisor))
        while report[0].measured_s < 1.0:
            report[0].turn(time.monotonic())
            yield
        pids.append(supervisor.crew.members["recorder"].pid)
        asked_to_end_s.append(report[0].measured_s)

    events = fakes.play(scenario, recorder="stubborn")  # goes on for another 1.5 s
    assert gone(pids[0])
    assert any(event.startswith("recorder: did not end within") for event in events)
    loop = report[0].result()["loops"]["recorder"]
    assert 0.5 < loop["ticks"] / loop["rate_hz"] < asked_to_end_s[0] + 0.4


UP = """
import sys
sys.path.insert(0, {root!r})
from pathlib import Path
from tests.supervisor.test_rig_of_fakes import Fakes
from services.runtime.process import Options
from services.supervisor import session
from services.cli import up
from services.visualization.web import build

fakes = Fakes(Options({rig!r}, None, ()))
real = session.SessionOptions
session.TABLE = fakes.table()
session.SessionOptions = lambda options, **rest: real(options, fakes.table(), **rest)
build.reproach = lambda: "page: not the one of here"
sys.argv = ["trocar", "up", "--rig", {rig!r}, *sys.argv[1:]]
from services.cli.app import main
main()
"""


def _command(fakes: Fakes, *arguments: str) -> list[str]:
    script = UP.format(root=str(HERE.parents[1]), rig=fakes.options.rig)
    return with_us([sys.executable, "-c", script, *arguments])


def _trocar(fakes: Fakes, verb: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "services.cli.app", verb, "--rig", fakes.options.rig, *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=False, cwd=HERE.parents[1])


def test_up_announces_the_page_and_ctrl_c_still_writes_the_report(fakes: Fakes, tmp_path: Path) -> None:
    file = tmp_path / "run.json"
    up = subprocess.Popen(_command(fakes, "--json", str(file)), stderr=subprocess.PIPE, text=True)
    assert up.stderr is not None
    lines = [up.stderr.readline()]
    while "is running: open http://127.0.0.1:" not in lines[-1]:
        assert lines[-1], "it ended"
        lines.append(up.stderr.readline())
    assert sum("page: not the one of here" in line for line in lines) == 1
    _until_measured(fakes)
    up.send_signal(signal.SIGINT)
    assert up.wait(PATIENCE_S) == 0
    up.stderr.close()
    assert json.loads(file.read_text())["loops"]["gateway"]["ticks"] > 0


def _until_measured(fakes: Fakes) -> None:
    """Wait until the gateway has ticked for longer than what a report leaves out, and said so."""
    bus = ZmqBus(config.load_rig(fakes.options.rig).transport, reads_every=["gateway.health"])
    try:
        heard: list[float] = []
        deadline = time.monotonic() + PATIENCE_S
        while not heard or heard[-1] < heard[0] + run_report.SETTLE_S + 1.0:
            assert time.monotonic() < deadline
            heard += [frame.body.uptime_s for frame in bus.drain("gateway.health")]
            time.sleep(0.02)
    finally:
        bus.close()


def test_a_start_without_a_terminal_says_first_where_to_look(fakes: Fakes) -> None:
    said: list[str] = []
    with subprocess.Popen(_command(fakes), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as up:
        assert up.stdout is not None
        while not said or "is running: open" not in said[-1]:
            said.append(up.stdout.readline())
            assert said[-1], "it ended"
        up.send_signal(signal.SIGINT)
        assert up.wait(PATIENCE_S) == 0
    (starts,) = (line for line in said if " is starting: open http://127.0.0.1:" in line)
    assert starts.split("open ")[1].strip() == said[-1].split("open ")[1].split()[0]


@pytest.mark.parametrize("where", ["closed", "a pipe that nobody reads"])
def test_a_start_whose_output_nobody_takes_goes_on(fakes: Fakes, where: str) -> None:
    read, write = os.pipe()
    os.close(read)
    command = ["sh", "-c", 'exec "$@" >&-' if where == "closed" else 'exec "$@"', "sh", *_command(fakes)]
    with subprocess.Popen(command, stdout=write, stderr=subprocess.PIPE, text=True) as up:
        os.close(write)
        assert up.stderr is not None
        line = "-"
        while "is running: open" not in line:
            line = up.stderr.readline()
            assert line, "it ended"
        up.send_signal(signal.SIGINT)
        assert up.wait(PATIENCE_S) == 0


def test_others_live_on_without_their_supervisor_and_down_ends_them(fakes: Fakes) -> None:
    up = subprocess.Popen(_command(fakes), stderr=subprocess.PIPE, text=True)
    assert up.stderr is not None
    while "is running: open" not in up.stderr.readline():
        assert up.poll() is None
    armed = _trocar(fakes, "arm")
    assert (armed.returncode, armed.stderr) == (0, "")
    up.kill()
    up.wait()
    up.stderr.close()
    again = subprocess.run(_command(fakes), capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert again.returncode == 3
    assert again.stderr.count("\n") == 1
    assert "a rig is running here already: physics (process" in again.stderr
    shown = json.loads(_trocar(fakes, "top", "--once", "--json").stdout)
    assert {row["name"] for row in shown["processes"]} >= {"gateway", "haptics", "physics"}
    sniffed = _trocar(fakes, "sniff", "gateway.state", "--count", "2", "--json")
    assert [json.loads(text)["topic"] for text in sniffed.stdout.splitlines()] == ["gateway.state"] * 2
    down = _trocar(fakes, "down", "--json")
    assert set(json.loads(down.stdout)["ended"]) == {"gateway", "haptics", "physics", "visualization", "recorder"}
    assert json.loads(_trocar(fakes, "down", "--json").stdout) == {"ended": []}


def test_without_the_web_packages_there_is_no_page_and_flights_are_kept_all_the_same(
    fakes: Fakes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(page, "PACKAGES", ("a_package_that_nobody_has",))
    flights = Path(fakes.options.rig).parent / "flights"
    pids: list[int] = []

    def scenario(supervisor: Supervisor) -> Scenario:
        yield from until_running(supervisor)
        pids.extend(_children("onlooker"))
        yield from until(flights.is_dir)  # whoever keeps them looks on
        os.kill(supervisor.crew.members["haptics"].pid, signal.SIGKILL)
        yield from until(lambda: any(flights.iterdir()))

    events = fakes.play(scenario)
    assert len(pids) == 1
    assert gone(pids[0])
    assert any(event.startswith("no web page: a_package_that_nobody_has is not installed") for event in events)


def ask(supervisor: Supervisor, path: str) -> httpx.Response:
    return httpx.get(supervisor.page_address.partition("#")[0] + path, timeout=PATIENCE_S)


def test_the_page_is_a_process_of_its_own_and_is_started_again(fakes: Fakes) -> None:
    def scenario(supervisor: Supervisor) -> Scenario:
        yield from until_running(supervisor)
        told: list[dict[str, Any]] = []
        asking = threading.Thread(target=lambda: told.append(_once_running(supervisor)))
        asking.start()
        yield from until(lambda: not asking.is_alive())
        assert told[0]["state"] == "running"
        assert {row["name"] for row in told[0]["processes"]} == set(supervisor.crew.members)
        (page_server,) = _page_servers()
        expected = -10 if os.geteuid() == 0 else 0
        assert os.getpriority(os.PRIO_PROCESS, page_server) == expected, "it answers also beside what computes"
        os.kill(page_server, signal.SIGKILL)
        yield from until(lambda: any("the page's process ended" in event.text for event in supervisor.events))
        asking = threading.Thread(target=lambda: told.append(_once_running(supervisor)))
        asking.start()
        yield from until(lambda: not asking.is_alive())
        assert told[1]["state"] == "running"
        assert [member.restarts.count for member in supervisor.crew.members.values()] == [0] * 5, "the rig goes on"

    fakes.play(scenario)
    assert _page_servers() == []


def _once_running(supervisor: Supervisor) -> dict[str, Any]:
    """Return the state that the page shows once it serves, and has heard that the rig runs."""
    for _ in range(300):
        with suppress(httpx.HTTPError):
            told = ask(supervisor, "api/state").json()
            if told.get("state") == "running":
                return dict(told)
        time.sleep(0.3)
    raise AssertionError("the page does not say that the rig runs")


def _page_servers() -> list[int]:
    return _children("page_server")


def _children(module: str) -> list[int]:
    children = Path(f"/proc/self/task/{os.getpid()}/children").read_text().split()
    return [int(pid) for pid in children if module.encode() in Path(f"/proc/{pid}/cmdline").read_bytes()]


@pytest.mark.skipif(not fifo_is_granted(), reason="this system refuses SCHED_FIFO")
def test_it_judges_in_real_time_and_what_it_starts_is_ordinary(fakes: Fakes) -> None:
    with open(fakes.options.rig, "a") as file:
        file.write("processes: {supervisor: {priority: 10}}\n")
    had: dict[str, int] = {}

    def scenario(supervisor: Supervisor) -> Scenario:
        yield from until_running(supervisor)
        had["judge"] = os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK
        had.update({name: os.sched_getscheduler(member.pid) for name, member in supervisor.crew.members.items()})
        had["page"] = next(os.sched_getscheduler(pid) for pid in _page_servers())

    kept = os.sched_getscheduler(0)
    try:
        fakes.play(scenario)
    finally:
        os.sched_setscheduler(0, kept, os.sched_param(0))
    assert had.pop("judge") == os.SCHED_FIFO
    assert set(had.values()) == {os.SCHED_OTHER}
