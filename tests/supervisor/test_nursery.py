"""Processes that are copies of one that has imported what they import: children of ours, and otherwise as any."""

from __future__ import annotations

import os
import select
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

import services
from services.supervisor.launcher import Child, open_sink
from services.supervisor.nursery import Birth, Nursery
from services.supervisor.processes import ENVIRONMENT, ProcessSpec

_PATIENCE_S = 120.0
_TELLS = """
import gc, os, signal, sys
print(os.getppid(), os.getsid(0) == os.getpid(), os.getpgid(0) == os.getpid())
print("numba" in sys.modules, "services.scenes" in sys.modules, "zmq" in sys.modules)
print(os.environ.get("FAKE_NAME"), sys.argv[0], sys.orig_argv[1:4], len(os.listdir("/proc/self/fd")), gc.isenabled())
"""
_TIMER = ProcessSpec("timer", "timeit", environment={**ENVIRONMENT, "FAKE_NAME": "physics"})


def _says(statement: str) -> list[str]:
    return ["-n1", "-r1", statement]


@pytest.fixture
def nursery() -> Iterator[Nursery]:
    with Nursery() as opened:
        yield opened


@pytest.fixture
def log_file(tmp_path: Path) -> Path:
    tmp_path.chmod(0o700)
    return tmp_path / "log"


def _hear(nursery: Nursery) -> None:
    select.select([nursery.descriptor], [], [], _PATIENCE_S)
    nursery.hear()


def _pid(nursery: Nursery, birth: Birth) -> int:
    while birth.pid is None:
        _hear(nursery)
    return birth.pid


def _born(nursery: Nursery, statement: str, log_file: Path) -> Child:
    while not nursery.ready:
        assert not nursery.lost
        _hear(nursery)
    with open_sink(log_file) as sink:
        birth = nursery.ask(_TIMER, _says(statement), sink.fileno())
    return Child(_TIMER, _pid(nursery, birth), log_file)


def _ended(child: Child) -> int:
    deadline_s = time.monotonic() + _PATIENCE_S
    while (status := child.wait(1.0)) is None:
        assert time.monotonic() < deadline_s
    return status


def test_who_is_born_is_a_child_of_ours_with_a_session_a_name_and_a_sink_of_its_own(
    nursery: Nursery, log_file: Path
) -> None:
    child = _born(nursery, _TELLS, log_file)
    assert _ended(child) == 0
    tree, modules, identity, *_ = child.lines()
    child.close()
    assert tree == f"{os.getpid()} True True"
    assert modules == "True True True"
    started = _started(log_file.with_name("other"))
    assert identity == started[2].replace("True", "False"), "as one that is started, but for the collector"
    assert identity.startswith("physics ")


def _started(log_file: Path) -> list[str]:
    child = Child.started(_TIMER, _says(_TELLS), log_file)
    assert _ended(child) == 0
    lines = child.lines()
    child.close()
    return lines


def test_it_is_listed_under_its_own_command_line(nursery: Nursery, log_file: Path) -> None:
    child = _born(nursery, "import time; print('here', flush=True); time.sleep(600)", log_file)
    while "here" not in child.lines():
        time.sleep(0.01)
    words = Path(f"/proc/{child.pid}/cmdline").read_bytes().rstrip(b"\0").decode().split("\0")
    assert words[:3] == [sys.executable, "-m", "timeit"]
    assert words[-1].startswith("import time")
    assert child.kill() == -signal.SIGKILL
    child.close()


def test_its_end_is_noticed_and_told_as_of_one_that_was_started(nursery: Nursery, log_file: Path) -> None:
    child = _born(nursery, "raise ValueError('no')", log_file)
    assert _ended(child) == 1
    assert child.lines()[-1] == "ValueError: no"
    child.close()
    child = _born(nursery, "import time; time.sleep(600)", log_file)
    assert child.end() is None
    os.kill(child.pid, signal.SIGTERM)
    assert _ended(child) == -signal.SIGTERM
    child.close()


def test_orphans_become_ours_only_while_one_is_born(nursery: Nursery, log_file: Path) -> None:
    """Whoever a process leaves behind would stay a zombie here."""
    child = _born(nursery, "import os, time; os.fork() or time.sleep(600); print(os.getpid())", log_file)
    assert _ended(child) == 0
    child.close()
    with pytest.raises(ChildProcessError):
        os.waitid(os.P_PGID, child.pid, os.WEXITED | os.WNOHANG)


def test_of_a_nursery_that_is_gone_nobody_is_born(nursery: Nursery, log_file: Path) -> None:
    assert nursery.bears(_TIMER)
    os.kill(nursery.pid, signal.SIGKILL)
    while not nursery.lost:
        _hear(nursery)
    assert not nursery.bears(_TIMER)
    with open_sink(log_file) as sink:
        assert nursery.ask(_TIMER, _says("pass"), sink.fileno()).pid == -1


def test_another_library_environment_is_not_for_it(nursery: Nursery) -> None:
    assert not nursery.bears(ProcessSpec("timer", "timeit", environment={**ENVIRONMENT, "GLIBC_TUNABLES": ""}))


def test_newer_source_is_imported_anew(tmp_path: Path, log_file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root, tree = Path(services.__file__).parents[1], tmp_path / "tree"
    for name in ("services", "protocol"):
        shutil.copytree(root / name, tree / name, ignore=shutil.ignore_patterns("__pycache__", "web"))
    monkeypatch.chdir(tree)
    monkeypatch.setenv("PYTHONPATH", str(tree))
    asked = "import sys; print('services.scenes' in sys.modules)"
    with Nursery() as nursery:
        said = []
        for touched in (False, True):
            if touched:
                os.utime(tree / "services" / "scenes" / "__init__.py", (0, 0))
            child = _born(nursery, asked, log_file)
            assert _ended(child) == 0
            said.append(child.lines()[0])
            child.close()
    assert said == ["True", "False"]


@pytest.mark.parametrize("command", [["-m", "services.supervisor"], ["-m", "services.cli.app", "up"]])
def test_too_few_descriptors_are_a_sentence_before_anything_starts(command: list[str], tmp_path: Path) -> None:
    least = ["bash", "-c", 'ulimit -n 64; exec "$@"', "-", sys.executable, *command]
    environment = os.environ | {"TMPDIR": str(tmp_path), "XDG_RUNTIME_DIR": str(tmp_path)}
    ended = subprocess.run(least, env=environment, capture_output=True, text=True, timeout=100)
    assert ended.returncode == 1
    assert ended.stderr.count("\n") == 1
    assert "only 64 files may be open at once, a rig needs 2" in ended.stderr
    assert list(tmp_path.iterdir()) == []


def test_a_zygote_whose_supervisor_is_gone_before_it_is_ready_ends_without_a_word() -> None:
    """A rig that is refused at its start closes the link while the zygote still imports."""
    ours, its = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    command = [sys.executable, "-m", "services.supervisor.zygote", str(its.fileno())]
    with subprocess.Popen(command, pass_fds=(its.fileno(),), stderr=subprocess.PIPE, text=True) as zygote:
        its.close()
        ours.close()
        assert zygote.communicate(timeout=_PATIENCE_S) == (None, "")
    assert zygote.returncode == 0
