"""Niceness counts beside other sessions, where the kernel makes a group of each."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.autogroups import may_be_set
from trocar.services.runtime.realtime import autogroup
from trocar.services.supervisor.crew.launcher import Child
from trocar.services.supervisor.crew.processes import ProcessSpec

GROUP = Path("/proc/self/autogroup")
_SET = "from trocar.services.runtime.realtime import realtime; realtime.set_up(None, None, 7)"
_TELL = "import os; print(os.getsid(0) == os.getpid(), open('/proc/self/autogroup').read())"

needs_groups = pytest.mark.skipif(
    not may_be_set(), reason="this system makes no groups of sessions, or lets none be changed"
)


def _in_child(code: str, *, session: bool) -> str:
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, check=True, start_new_session=session)
    return done.stdout.strip()


@needs_groups
def test_a_process_with_a_session_of_its_own_is_as_nice_to_others_as_to_its_own() -> None:
    assert _in_child(f"{_SET}; {_TELL}", session=True).endswith("nice 7")


_CLIMB = """from trocar.services.runtime.realtime.scheduling import Scheduling, SchedulingRequest
def refused(*_): raise PermissionError
Scheduling._take_fifo = refused
s = Scheduling.request(SchedulingRequest(5, 0.1))"""


@needs_groups
@pytest.mark.parametrize("leads", [True, False])
def test_a_judge_on_the_rung_of_niceness_has_it_beside_other_sessions_only_where_it_leads_one(leads: bool) -> None:
    """As one that a service manager or `setsid` starts does; in a terminal the group is the shell's."""
    *had, group = _in_child(f"{_CLIMB}; s.resume(); print(s.had); {_TELL}", session=leads).splitlines()
    if not had[0].startswith("nice -20"):
        pytest.skip("this user may not be less nice")
    assert group.endswith("nice -20") is leads


@needs_groups
def test_the_session_of_somebody_else_stays_as_it_is() -> None:
    before = GROUP.read_text()
    assert not _in_child(f"{_SET}; {_TELL}", session=False).endswith("nice 7")
    assert GROUP.read_text() == before


def test_who_waits_its_turn_gets_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(autogroup, "_APART_S", 0.0)
    monkeypatch.setattr(os, "getsid", lambda _pid: os.getpid())
    asked: list[str] = []

    def write(_path: Path, text: str) -> int:
        asked.append(text)
        if len(asked) < 3:
            raise BlockingIOError
        return len(text)

    group = tmp_path / "autogroup"
    group.write_text("/autogroup-7 nice 0\n")
    monkeypatch.setattr(Path, "write_text", write)
    assert autogroup.set_group_niceness(-10, group)
    assert asked == ["-10"] * 3


def test_a_group_that_has_its_niceness_is_not_written_to(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Of all groups of the machine ten are changed in a second: those who ask for nothing new kept others waiting."""
    group = tmp_path / "autogroup"
    group.write_text("/autogroup-7 nice 0\n")
    monkeypatch.setattr(os, "getsid", lambda _pid: os.getpid())
    monkeypatch.setattr(Path, "write_text", lambda *_: pytest.fail("it was written to"))
    assert autogroup.set_group_niceness(0, group)


def test_a_kernel_without_groups_and_one_that_refuses_are_no_error(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(os, "getsid", lambda _pid: os.getpid())
    assert not autogroup.set_group_niceness(-10, tmp_path / "nowhere" / "autogroup")
    assert not autogroup.set_group_niceness(-10, tmp_path)


def test_each_process_of_the_rig_leads_a_session(tmp_path: Path) -> None:
    tmp_path.chmod(0o700)
    child = Child(
        ProcessSpec("timer", "timeit"), ["-n", "1", "-r", "1", "import time; time.sleep(60)"], tmp_path / "log"
    )
    try:
        assert os.getsid(child.pid) == child.pid
    finally:
        child.kill()
        child.close()
