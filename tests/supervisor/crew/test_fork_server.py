"""Processes that are forks of one that has imported what they import: children of ours, and otherwise as any."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest

from tests.patience import PATIENCE_S
from tests.supervisor.fakes import HERE, Fakes, Scenario, gone, until, until_running
from trocar.services.supervisor.control.supervisor import Supervisor
from trocar.services.supervisor.crew import fork_link, restart_policy, silence
from trocar.services.supervisor.crew.fork_link import ForkServer
from trocar.services.supervisor.crew.launcher import Child
from trocar.services.supervisor.crew.processes import ENVIRONMENT, ProcessSpec

pytestmark = pytest.mark.usefixtures("soon", "pageless")

_TELLS = """
import gc, os, signal, sys
print(os.getppid(), os.getsid(0) == os.getpid(), os.getpgid(0) == os.getpid())
print(*(name in sys.modules for name in ("numba", "scipy.linalg", "trocar.services.scenes", "zmq")))
names = [f"/proc/self/fd/{each}" for each in os.listdir("/proc/self/fd")]
files = [os.readlink(each) for each in names if os.path.exists(each)]
own = [each for each in files if ".so" not in each]  # newer libffi keeps a descriptor of its own library
print(os.environ.get("FAKE_NAME"), sys.argv[0], sys.orig_argv[1:4], len(own), gc.isenabled())
"""
_TIMER = ProcessSpec("timer", "timeit", environment={**ENVIRONMENT, "FAKE_NAME": "physics"})
_SLEEPS = "import time; print('here', flush=True); time.sleep(600)"
#: A supervisor that starts a server, lets it fork one that sleeps where it is told to, and says who is who.
_SUPERVISOR = f"""
import sys, time
from pathlib import Path
from trocar.services.supervisor.crew.fork_link import ForkServer
server, child = ForkServer(), 0
if sys.argv[2] == "forked":
    while (child := server.fork("timeit", ["-n1", "-r1", {_SLEEPS!r}], {{}}, Path(sys.argv[1]))) is None:
        time.sleep(0.01)
print(server.pid, child, flush=True)
time.sleep(600)
"""


def _says(statement: str) -> list[str]:
    return ["-n1", "-r1", statement]


def _until(condition: Callable[[], object]) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline_s
        time.sleep(0.01)


@pytest.fixture(scope="module")
def server() -> Iterator[ForkServer]:
    with closing(ForkServer()) as opened:
        yield opened


@pytest.fixture
def log_file(tmp_path: Path) -> Path:
    tmp_path.chmod(0o700)
    return tmp_path / "log"


def _forked(server: ForkServer, statement: str, log_file: Path) -> Child:
    says, pids = _says(statement), list[int]()

    def has_answered() -> bool:
        pid = server.fork(_TIMER.module, says, _TIMER.environment, log_file)
        pids.extend([] if pid is None else [pid])
        return bool(pids)

    _until(has_answered)
    return Child(_TIMER, says, log_file, forked=pids[0])


def _ended(child: Child) -> tuple[int, list[str]]:
    _until(lambda: child.wait(1.0) is not None)
    lines = child.lines()
    child.close()
    status = child.end()
    assert status is not None
    return status, lines


def test_a_fork_is_a_child_of_ours_with_a_session_a_name_and_a_sink_of_its_own(
    server: ForkServer, log_file: Path
) -> None:
    status, (tree, modules, identity, *_) = _ended(_forked(server, _TELLS, log_file))
    assert status == 0
    assert tree == f"{os.getpid()} True True"
    assert modules == "True True True True"
    started = _ended(Child(_TIMER, _says(_TELLS), log_file.with_name("other")))[1]
    assert identity == started[2].replace("True", "False"), "as one that is started, but for the collector"
    assert identity.startswith("physics ")


def test_it_is_listed_under_its_own_command_line(server: ForkServer, log_file: Path) -> None:
    child = _forked(server, _SLEEPS, log_file)
    _until(lambda: "here" in child.lines())
    words = Path(f"/proc/{child.pid}/cmdline").read_bytes().rstrip(b"\0").decode().split("\0")
    assert words[:3] == [sys.executable, "-m", "timeit"]
    assert words[-1].startswith("import time")
    assert child.kill() == -signal.SIGKILL
    child.close()


def test_its_end_is_noticed_and_told_as_of_one_that_was_started(server: ForkServer, log_file: Path) -> None:
    status, lines = _ended(_forked(server, "raise ValueError('no')", log_file))
    assert (status, lines[-1]) == (1, "ValueError: no")
    child = _forked(server, "import time; time.sleep(600)", log_file)
    assert child.end() is None
    os.kill(child.pid, signal.SIGTERM)
    assert _ended(child)[0] == -signal.SIGTERM


def test_orphans_are_the_systems_again_once_a_fork_is_there(server: ForkServer, log_file: Path) -> None:
    """Whoever a process leaves behind would stay a zombie here."""
    child = _forked(server, "import os, time; os.fork() or time.sleep(600); time.sleep(1); print('here')", log_file)
    assert _ended(child)[0] == 0
    with pytest.raises(ChildProcessError):
        os.waitid(os.P_PGID, child.pid, os.WEXITED | os.WNOHANG)


def test_a_fork_that_is_awaited_no_more_never_runs(server: ForkServer, log_file: Path) -> None:
    _until(lambda: not server.imports())
    os.kill(server.pid, signal.SIGSTOP)  # or it may have answered already
    assert server.fork(_TIMER.module, _says("print('here')"), _TIMER.environment, log_file) is None
    server.abandon()
    os.kill(server.pid, signal.SIGCONT)
    status, lines = _ended(_forked(server, "import time; time.sleep(0.3); print('there')", log_file.with_name("other")))
    assert (status, lines[0]) == (0, "there")
    assert log_file.read_text() == ""


@pytest.mark.parametrize("struck", [signal.SIGKILL, signal.SIGSTOP])
def test_where_the_server_does_not_answer_processes_are_started_without(
    struck: signal.Signals, log_file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fork_link, "_FORK_S", 0.3)
    with closing(ForkServer()) as server:
        _until(lambda: not server.imports())
        pid = server.pid
        os.kill(pid, struck)
        status, (tree, modules, *_) = _ended(_forked(server, _TELLS, log_file))
        assert (status, tree, modules) == (0, f"{os.getpid()} True True", "False False False False")
        assert server.pid == 0
        assert gone(pid)


def _turned(server: ForkServer, until: Callable[[], object]) -> list[str]:
    """Look after a server until something holds; return what was said."""
    told: list[str] = []

    def turn() -> object:
        told.extend(server.tend_server())
        return until()

    _until(turn)
    return told


@pytest.mark.parametrize(
    ("struck", "stopped_s", "silent_s", "why"),
    [
        (signal.SIGKILL, 60.0, 60.0, "has ended"),
        (signal.SIGSTOP, 0.1, 60.0, "is stopped by a signal"),
        (signal.SIGSTOP, 60.0, 0.1, "said nothing for 0.[12] s"),
    ],
)
def test_a_server_that_is_lost_is_told_once_and_replaced(
    struck: signal.Signals, stopped_s: float, silent_s: float, why: str, log_file: Path, soon_again: pytest.MonkeyPatch
) -> None:
    """It was noticed at the next fork only, which waited 5 s for it, and from then on there was none."""
    with closing(ForkServer()) as server:
        _until(lambda: not server.imports())
        soon_again.setattr(silence, "HEARTBEAT_S", stopped_s)
        soon_again.setattr(fork_link, "_SILENT_S", silent_s)
        first = server.pid
        os.kill(first, struck)
        told = _turned(server, lambda: server.pid not in (0, first))
        (said,) = told
        assert re.fullmatch(rf"supervisor: the fork server \(process {first}\) {why}: a new one is started", said)
        assert gone(first)
        assert server.imports()
        assert server.fork(_TIMER.module, _says("0"), {}, log_file) == 0, "nobody waits for the imports of the new one"


@pytest.fixture
def soon_again(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """Let a server be asked often, and started again soon."""
    monkeypatch.setattr(fork_link, "_ASK_EVERY_S", 0.05)
    monkeypatch.setattr(restart_policy, "HELPER_BACKOFF_S", (0.05,))
    return monkeypatch


def test_a_server_that_is_lost_again_and_again_is_left_alone_for_a_minute(soon_again: pytest.MonkeyPatch) -> None:
    soon_again.setattr(restart_policy, "HELPER_RETRIES", 1)
    soon_again.setattr(fork_link, "MINUTE_S", 2.0)
    with closing(ForkServer()) as server:
        os.kill(server.pid, signal.SIGKILL)
        told = _turned(server, lambda: server.pid == 0) + _turned(server, lambda: server.pid)
        os.kill(server.pid, signal.SIGKILL)
        told += _turned(server, lambda: server.pid == 0)
        time.sleep(0.1)
        assert server.tend_server() == []
        assert server.pid == 0
        assert [each.rpartition(": ")[2] for each in told] == [
            "a new one is started", "for a minute processes import for themselves",
        ]  # fmt: skip
        assert _turned(server, lambda: server.pid) == []


def test_a_delay_of_our_own_is_no_silence_of_the_server(soon_again: pytest.MonkeyPatch) -> None:
    soon_again.setattr(fork_link, "_SILENT_S", 2.0)
    with closing(ForkServer()) as server:
        _until(lambda: not server.imports())
        os.kill(server.pid, signal.SIGSTOP)
        assert _turned(server, lambda: server._silence.awaits) == []
        time.sleep(0.6)
        assert server.tend_server() == [], "it may have been held up with us"
        os.kill(server.pid, signal.SIGCONT)
        assert _turned(server, lambda: not server._silence.awaits) == []


def test_a_server_that_never_ends_its_imports_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fork_link, "_IMPORTS_S", 0.1)
    with closing(ForkServer()) as server:
        os.kill(server.pid, signal.SIGSTOP)
        _until(lambda: not server.imports())
        assert server.pid == 0


@pytest.mark.parametrize("stage", ["importing", "forked"])
def test_it_ends_with_its_supervisor_whatever_ends_that_and_holds_no_output_open(log_file: Path, stage: str) -> None:
    """Whoever reads what a command says waits until nobody can write to it any more."""
    command = [sys.executable, "-c", _SUPERVISOR, str(log_file), stage]
    supervisor = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    assert supervisor.stdout is not None
    server, child = map(int, supervisor.stdout.readline().split())
    supervisor.kill()
    assert supervisor.communicate(timeout=PATIENCE_S)[0] == ""
    try:
        _until(lambda: gone(server))
    finally:
        if child:  # as every process of a rig whose supervisor was killed, it goes on
            os.kill(child, signal.SIGKILL)


def test_who_looks_at_processes_that_others_start_keeps_no_fork_server(fakes: Fakes) -> None:
    options = replace(fakes.options, overrides=("supervisor.mode=attach",))
    with closing(ForkServer()) as fork_server:
        replace(fakes, options=options, fork_server=fork_server).play(lambda _supervisor: iter([None]))
        assert fork_server.pid == 0


def test_processes_are_forked_also_when_they_are_restarted_and_without_a_server_start_by_themselves(
    fakes: Fakes, monkeypatch: pytest.MonkeyPatch, soon_again: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join((str(HERE), str(HERE.parents[1]))))
    forked, pids = list[bool](), list[int]()

    def scenario(supervisor: Supervisor) -> Scenario:
        yield from until_running(supervisor)
        members = supervisor.crew.members.values()
        forked.extend(_is_forked(member.pid) for member in members)
        member = supervisor.crew.members["haptics"]
        for ends_server in (False, True):
            if ends_server:
                os.kill(fork_server.pid, signal.SIGKILL)
            first = member.pid
            os.kill(first, signal.SIGKILL)
            yield from until(lambda: member.up and member.pid != first)  # noqa: B023
            yield from until_running(supervisor)
            assert gone(first)
            forked.append(_is_forked(member.pid))
        yield from until(lambda: fork_server.pid != 0 and not fork_server.imports())
        another, first = supervisor.crew.members["physics"], supervisor.crew.members["physics"].pid
        os.kill(first, signal.SIGKILL)
        yield from until(lambda: another.up and another.pid != first)
        forked.append(_is_forked(another.pid))
        pids.extend(member.pid for member in members)

    with closing(ForkServer()) as fork_server:
        events = replace(fakes, fork_server=fork_server).play(scenario)
    assert forked == [True] * 6 + [True, False, True]
    assert all(gone(pid) for pid in pids)
    assert sum(event.startswith("haptics: ended by SIGKILL") for event in events) == 2
    assert sum("the fork server" in event for event in events) == 1


def _is_forked(pid: int) -> bool:
    """Return whether a process is a fork of one that had more room for its command line."""
    return Path(f"/proc/{pid}/cmdline").read_bytes().endswith(b"\0\0")
