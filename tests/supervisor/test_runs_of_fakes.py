"""A rig of tiny processes as who started it sees it: what is printed, reported and shown, and how it is ended."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx
import pytest
import yaml

from tests.by_day import by_day
from tests.cli.conftest import Trocar, trocar
from tests.obeyed import until_obeyed
from tests.patience import PATIENCE_S
from tests.ports import base_port
from tests.supervisor.fakes import HERE, Fakes, Scenario, gone, page_servers, until, until_running
from tests.with_us import with_us
from trocar.services.cli.arm import RigPage, ask_at
from trocar.services.runtime.bus.zmq_bus import ZmqBus
from trocar.services.runtime.config import config
from trocar.services.supervisor import run_report
from trocar.services.supervisor.control.supervisor import Supervisor
from trocar.services.supervisor.crew import silence
from trocar.services.supervisor.crew.fork_link import ForkServer

__all__ = ["trocar"]


@pytest.fixture
def fakes(fakes: Fakes, server: ForkServer, soon: None) -> Fakes:
    """Return a rig whose processes import nothing anew where it is played in this process."""
    return replace(fakes, fork_server=server)


@pytest.mark.usefixtures("pageless")
def test_report_counts_the_running_time_only(fakes: Fakes, tmp_path: Path) -> None:
    report: list[run_report.RunReport] = []

    def scenario(supervisor: Supervisor) -> Scenario:
        report.append(run_report.RunReport(supervisor))
        while report[0].measured_s < 0.5:
            report[0].watch_run(time.monotonic())
            yield
        os.kill(supervisor.crew.members["haptics"].pid, signal.SIGKILL)
        while report[0].measured_s < 2.0:
            report[0].watch_run(time.monotonic())
            yield

    fakes.play(scenario, recorder="slow")
    result = json.loads(run_report.as_text(report[0].result()))
    assert result.keys() >= {"loops", "paths", "answered_next_tick", "topics", "restarts", "realtime", "machine"}
    (stay,) = result["rungs"]
    assert stay["level"] == 0
    assert stay["loops"]["gateway"]["ticks"] == result["loops"]["gateway"]["ticks"]
    assert result["restarts"] == {
        "gateway": 0, "physics": 0, "haptics": 1, "visualization": 0, "recorder": 0, "training": 0
    }  # fmt: skip
    gateway, slow = result["loops"]["gateway"], result["loops"]["recorder"]
    assert gateway.keys() >= {"rate_hz", "ticks", "misses", "miss_ratio", "lateness_us", "work_us"}
    assert gateway["lateness_us"].keys() == {"p50", "p99", "p99_9", "max"}
    # 200 Hz over two seconds, give or take a report at either end, or however long the machine kept one back; what
    # came before RUNNING is not in it.
    due = gateway["ticks"] + gateway["skipped"]
    assert 200 * 2 - 150 < due < 200 * report[0].measured_s + 150
    assert due / (gateway["ticks"] / gateway["rate_hz"]) == pytest.approx(200, rel=0.05)
    assert slow["miss_ratio"] > 0.2
    assert slow["work_us"]["p99"] > 5000
    own = result["supervisor"]["lateness_us"]
    assert 0.0 < own["p50"] <= own["p99"] <= own["max"]
    # A frame a tick, however many the machine left it; the frames of the last report are not all of the same ticks.
    assert result["topics"]["gateway.state"]["rate_hz"] == pytest.approx(gateway["rate_hz"], rel=0.05)
    assert any(fact["name"] == "scheduling" for fact in result["realtime"]["gateway"])


@pytest.mark.usefixtures("pageless")
def test_a_process_that_does_not_end_is_killed_and_counts_no_longer(
    fakes: Fakes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("trocar.services.supervisor.crew.crew.END_S", 1.5)
    report: list[run_report.RunReport] = []
    pids: list[int] = []
    asked_to_end_s: list[float] = []

    def scenario(supervisor: Supervisor) -> Scenario:
        report.append(run_report.RunReport(supervisor))
        while report[0].measured_s < 1.0:
            report[0].watch_run(time.monotonic())
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
from tests.supervisor.fakes import Fakes
from trocar.services.runtime.process.process import Options
from trocar.services.supervisor import session
from trocar.services.cli import up, validation
from trocar.services.visualization.web import build

fakes = Fakes(Options({rig!r}, None, ()))
real = session.SessionOptions
session.TABLE = fakes.table()
session.SessionOptions = lambda options, **rest: real(options, fakes.table(), **rest)
build.build_fault = lambda: "page: not the one of here"
validation._check = lambda options: None  # what a scene is checked against takes a second to import
sys.argv = ["trocar", "up", "--rig", {rig!r}, *sys.argv[1:]]
from trocar.services.cli.app import main
main()
"""


def _command(fakes: Fakes, *arguments: str) -> list[str]:
    script = UP.format(root=str(HERE.parents[1]), rig=fakes.options.rig)
    return with_us([sys.executable, "-c", script, *arguments])


def test_up_says_first_where_to_look_announces_the_page_and_ctrl_c_still_writes_the_report(
    fakes: Fakes, tmp_path: Path
) -> None:
    """Without a terminal, too."""
    file, said = tmp_path / "run.json", [""]
    command = _command(fakes, "--json", str(file))
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as up:
        assert up.stdout is not None
        while "is running: open http://127.0.0.1:" not in said[-1]:
            said.append(up.stdout.readline())
            assert said[-1], "it ended"
        _until_measured(fakes)
        up.send_signal(signal.SIGINT)
        assert up.wait(PATIENCE_S) == 0
    assert sum("page: not the one of here" in line for line in said) == 1
    (starts,) = (line for line in said if " is starting: open http://127.0.0.1:" in line)
    assert starts.split("open ")[1].strip() == said[-1].split("open ")[1].split()[0]
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


@pytest.mark.parametrize("where", by_day(["a pipe that nobody reads"], ["closed"]))
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


@pytest.mark.parametrize("kind", ["ipc", "tcp"])
def test_others_live_on_without_their_supervisor_and_down_ends_them(fakes: Fakes, trocar: Trocar, kind: str) -> None:
    """A rig over TCP held no locks: `trocar down` removed its configuration and let it run."""
    file = Path(fakes.options.rig)
    data = yaml.safe_load(file.read_text())
    data["transport"] |= {"kind": kind, "base_port": base_port(22_800)}
    file.write_text(yaml.safe_dump(data))
    up = subprocess.Popen(_command(fakes), stderr=subprocess.PIPE, text=True)
    assert up.stderr is not None
    while "is running: open" not in up.stderr.readline():
        assert up.poll() is None
    rig = ("--rig", fakes.options.rig)
    armed = trocar("arm", *rig)
    assert (armed.code, armed.err) == (0, "")
    up.kill()
    up.wait()
    up.stderr.close()
    again = subprocess.run(_command(fakes), capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert again.returncode == 3
    assert again.stderr.count("\n") == 1
    assert "a rig is running here already: physics (process" in again.stderr
    shown = json.loads(trocar("diagnose", "top", "--once", "--json", *rig).out)
    assert {row["name"] for row in shown["processes"]} >= {"gateway", "haptics", "physics"}
    sniffed = trocar("diagnose", "sniff", "gateway.state", "--count", "2", "--json", *rig)
    assert [json.loads(text)["topic"] for text in sniffed.out.splitlines()] == ["gateway.state"] * 2
    down = trocar("down", "--json", *rig)
    ended = {"gateway", "haptics", "physics", "visualization", "recorder", "training"}
    assert set(json.loads(down.out)["ended"]) == ended
    left = {"flights", file.name, "log"}
    end_s = time.monotonic() + PATIENCE_S
    while {path.name for path in file.parent.iterdir()} - left:  # the school notices that nobody is there
        assert time.monotonic() < end_s, list(file.parent.iterdir())
        time.sleep(0.1)
    assert json.loads(trocar("down", "--json", *rig).out) == {"ended": []}


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
        (page_server,) = page_servers()
        expected = -10 if os.geteuid() == 0 else 0
        assert os.getpriority(os.PRIO_PROCESS, page_server) == expected, "it answers also beside what computes"
        os.kill(page_server, signal.SIGKILL)
        yield from until(lambda: any("the page's process ended" in event.text for event in supervisor.events))
        asking = threading.Thread(target=lambda: told.append(_once_running(supervisor)))
        asking.start()
        yield from until(lambda: not asking.is_alive())
        assert told[1]["state"] == "running"
        assert [member.restarts.count for member in supervisor.crew.members.values()] == [0] * 6, "the rig goes on"

    fakes.play(scenario)
    assert page_servers() == []


def asked(question: Callable[[], Any]) -> list[Any]:
    """Return a list in which the answer will be."""
    answers: list[Any] = []
    threading.Thread(target=lambda: answers.append(question())).start()
    return answers


def _posted(url: str, headers: dict[str, str]) -> object:
    try:
        return httpx.post(url, headers=headers, timeout=0.5)
    except httpx.TimeoutException:
        return "given up"


def test_a_command_that_was_given_up_is_not_carried_out_by_a_page_that_hung(
    fakes: Fakes, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It armed the rig after `trocar arm` had failed with exit code 3."""
    monkeypatch.setattr(silence, "HEARTBEAT_S", PATIENCE_S)

    def scenario(supervisor: Supervisor) -> Scenario:
        yield from until_running(supervisor)
        address, token = supervisor.page_address.split("#token=")
        told = asked(lambda: _once_running(supervisor))
        yield from until(lambda: bool(told))
        before = {"X-Trocar-Token": token, "X-Trocar-Before": f"{told[0]['incarnation']} {told[0]['t'] + 1.5:.3f}"}
        (page_server,) = page_servers()
        os.kill(page_server, signal.SIGSTOP)
        given_up = asked(lambda: _posted(f"{address}api/arm", before))
        yield from until(lambda: bool(given_up))
        assert given_up == ["given up"]
        ends_s = time.monotonic() + 1.5
        yield from until(lambda: time.monotonic() > ends_s)
        os.kill(page_server, signal.SIGCONT)
        yield from until(
            lambda: any("confirmed to its sender: nothing was done" in event.text for event in supervisor.events)
        )
        assert supervisor.body().armed == 0
        armed = asked(lambda: until_obeyed(lambda: ask_at(RigPage(address), token, "arm")))
        yield from until(lambda: bool(armed))
        assert armed == ["armed: hands may be pushed"]

    fakes.play(scenario)


def _once_running(supervisor: Supervisor) -> dict[str, Any]:
    """Return the state that the page shows once it serves, and has heard that the rig runs."""
    for _ in range(1800):
        with suppress(httpx.HTTPError):
            told = ask(supervisor, "api/state").json()
            if told.get("state") == "running":
                return dict(told)
        time.sleep(0.05)
    raise AssertionError("the page does not say that the rig runs")
