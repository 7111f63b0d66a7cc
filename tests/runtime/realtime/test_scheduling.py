"""A loop has SCHED_FIFO or, where that is refused, niceness -20, as the kernel tells it afterwards."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from trocar.services.runtime.config.config import load_rig
from trocar.services.runtime.realtime import realtime, scheduling
from trocar.services.runtime.realtime.scheduling import Scheduling, SchedulingRequest

RIGS = Path(__file__).parents[3] / "configs" / "rigs"

#: Takes what is granted, if need be without FIFO, and tells it: as a thread, as its bus does, and as a child sees it.
_TAKE = """
import json, os, subprocess, sys, threading
from trocar.services.runtime.realtime import scheduling
from trocar.services.runtime.realtime.scheduling import Scheduling, SchedulingRequest

def refused(*_):
    raise PermissionError(1, "refused here")
{more}
threading.Thread(target=threading.Event().wait, daemon=True).start()
asked = Scheduling.request(SchedulingRequest(80, 0.3))
before = os.getpriority(os.PRIO_PROCESS, 0)
asked.relax()
asked.resume(alone={alone})
child = "import os; print(os.sched_getscheduler(0), os.getpriority(os.PRIO_PROCESS, 0))"
ran = subprocess.run([sys.executable, "-c", child], capture_output=True, text=True, check=True).stdout.split()
print(json.dumps(dict(
    had=asked.had, refused=asked.refused, before=before, child=[int(word) for word in ran],
    niceness=[os.getpriority(os.PRIO_PROCESS, thread) for thread in map(int, os.listdir('/proc/self/task'))],
    policy=os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK,
)))
"""
NO_FIFO = "Scheduling._take_fifo = refused"


def take(*, alone: bool = False, more: str = "") -> dict[str, Any]:
    script = _TAKE.format(alone=alone, more=more)
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    result: dict[str, Any] = json.loads(done.stdout)
    return result


def _may_be_less_nice() -> bool:
    code = "import os; os.setpriority(os.PRIO_PROCESS, 0, -20)"
    return subprocess.run([sys.executable, "-c", code], capture_output=True, check=False).returncode == 0


needs_nice = pytest.mark.skipif(not _may_be_less_nice(), reason="nice -20 is refused")


@pytest.mark.parametrize("alone", [False, True])
def test_a_loop_has_fifo_where_it_is_granted_and_what_a_supervisor_starts_has_not(alone: bool) -> None:
    had = take(alone=alone)
    if had["policy"] != os.SCHED_FIFO:
        pytest.skip("this machine refuses SCHED_FIFO")
    assert (had["had"], had["refused"]) == ("FIFO 80", [])
    assert (had["child"][0] == os.SCHED_FIFO) is not alone


@needs_nice
def test_without_fifo_all_threads_of_a_loop_go_before_all_others() -> None:
    had = take(more=NO_FIFO)
    assert had["had"] == "nice -20"
    assert had["refused"] == ["fifo: refused (needs CAP_SYS_NICE or an rtprio limit)"]
    assert had["before"] == os.getpriority(os.PRIO_PROCESS, 0), "until it is ready the process is ordinary"
    assert had["policy"] == os.SCHED_OTHER
    assert had["niceness"] == [-20, -20]


@needs_nice
def test_what_a_supervisor_starts_is_ordinary_whatever_it_has_itself() -> None:
    assert take(more=NO_FIFO, alone=True)["child"] == [os.SCHED_OTHER, 0]


@needs_nice
def test_a_thread_that_ends_meanwhile_is_no_error() -> None:
    """A start failed by it: the thread ended between the look at the list and the call."""
    ended = int(subprocess.run(["sh", "-c", "echo $$"], capture_output=True, text=True, check=True).stdout)
    had = take(more=f"own = scheduling.own_threads\nscheduling.own_threads = lambda: [{ended}, *own()]\n{NO_FIFO}")
    assert (had["had"], had["niceness"]) == ("nice -20", [-20, -20])


def test_a_machine_that_grants_nothing_is_told_in_one_fact() -> None:
    fact = realtime.scheduling_fact(
        Scheduling(SchedulingRequest(80, 0.3), refused=["fifo: not here", "nice: not here"])
    )
    assert (fact.asked, fact.ok) == ("FIFO 80", False)
    assert fact.had == "OTHER; fifo: not here; nice: not here"


def test_a_groups_budget_smaller_than_the_loops_share_is_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    """A group that has used its budget up stands still for the rest of the second: worse than any other class."""
    monkeypatch.setattr(scheduling, "group_budget", lambda: 0.1)
    monkeypatch.setattr(scheduling, "_set_niceness", lambda niceness: None)
    found = Scheduling(SchedulingRequest(80, 0.7))
    found.resume()
    assert not found.is_fifo
    assert found.refused == ["fifo: its group has 10 % of a core, 70 needed"]


@pytest.mark.parametrize("path", sorted(RIGS.glob("*.yaml")), ids=lambda path: path.stem)
def test_what_the_loops_of_a_rig_need_is_there_on_two_cores(path: Path) -> None:
    processes = load_rig(str(path)).processes
    loops = [each for each in processes.values() if each.priority is not None]
    assert len(loops) == 4
    assert sum(each.share for each in loops) <= 2 * 0.95, "the kernel keeps 5 % of each core for ordinary threads"


def test_the_groups_budget_is_found_under_its_name_or_as_the_root_of_a_container(tmp_path: Path) -> None:
    mount, of = tmp_path / "cpu", tmp_path / "cgroup"
    of.write_text("4:memory:/a\n2:cpu,cpuacct:/rig/physics\n0::/\n")
    assert scheduling._group_folders(mount, of) == [mount / "rig/physics", mount]
    assert scheduling._group_folders(mount, tmp_path / "none") == [mount]
