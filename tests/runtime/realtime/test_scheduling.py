"""The ladder: each rung as the kernel has it afterwards, and the next one where a rung is refused."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest

from tests.patience import PATIENCE_S
from trocar.services.gateway.simulated import drive_process
from trocar.services.runtime.config.config import load_rig
from trocar.services.runtime.realtime import realtime, scheduling
from trocar.services.runtime.realtime.scheduling import Scheduling, SchedulingRequest

RIGS = Path(__file__).parents[3] / "configs" / "rigs"

#: Takes what is granted without FIFO, and tells it: as a thread, as its bus does, and as a child of it sees it.
_TAKE = """
import json, os, subprocess, sys, threading
from trocar.services.runtime.realtime import scheduling
from trocar.services.runtime.realtime.scheduling import Scheduling, SchedulingRequest, get_attributes

def refused(*_):
    raise PermissionError(1, "refused here")
Scheduling._fifo = refused
{more}
threading.Thread(target=threading.Event().wait, daemon=True).start()
asked = Scheduling.request(SchedulingRequest(80, {share}, min(os.sched_getaffinity(0))))
before = get_attributes(0)[1]
asked.resume(alone={alone}, period_ns={period_ns})
child = (
    "from trocar.services.runtime.realtime.scheduling import get_attributes;"
    "print(get_attributes(0)[1], get_attributes(0)[3])"
)
ran = subprocess.run([sys.executable, "-c", child], capture_output=True, text=True, check=True).stdout.split()
print(json.dumps(dict(
    had=asked.had, refused=asked.refused, before=before, child=[int(word) for word in ran],
    threads=[get_attributes(thread) for thread in scheduling.own_threads()],
    cores=len(os.sched_getaffinity(0)), all=os.cpu_count(),
)))
"""


def take(share: float = 0.3, *, alone: bool = False, period_ns: int = 1_000_000, more: str = "") -> dict[str, Any]:
    script = _TAKE.format(share=share, alone=alone, period_ns=period_ns, more=more)
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    result: dict[str, Any] = json.loads(done.stdout)
    return result


def granted() -> dict[str, str]:
    code = (
        "import json; from trocar.services.runtime.realtime.scheduling import SchedulingRequest, rungs_granted; "
        "print(json.dumps(rungs_granted(SchedulingRequest(80, 0.3, 0))))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    result: dict[str, str] = json.loads(done.stdout)
    return result


GRANTED = granted()
needs_deadline = pytest.mark.skipif(not GRANTED["deadline"].startswith("granted"), reason="SCHED_DEADLINE is refused")
needs_nice = pytest.mark.skipif(not GRANTED["nice"].startswith("granted"), reason="nice -20 is refused")
#: Reserves a tenth of a core after the other, on threads that then do nothing, until the kernel refuses.
_GREEDY = """
import threading, time
from trocar.services.runtime.realtime import scheduling
full = threading.Event()
def hold():
    try:
        scheduling.set_attributes(0, scheduling.DEADLINE, 1, runtime_ns=100_000)
    except OSError:
        full.set()
    threading.Event().wait()
while not full.is_set():
    threading.Thread(target=hold, daemon=True).start()
    time.sleep(0.01)
print("full", flush=True)
input()
"""
#: Whether a thread that steps aside yields, in the class that it has.
_ASIDE = """
import os
from trocar.services.runtime.realtime import scheduling
yielded = []
os.sched_yield = lambda: yielded.append(1)
scheduling.set_attributes(0, {policy}, {flags}, runtime_ns={runtime_ns})
scheduling.step_aside()
print(len(yielded))
"""
NO_DEADLINE = "Scheduling._deadline = refused"


@needs_deadline
def test_without_fifo_all_threads_of_a_loop_are_deadline_and_what_it_starts_is_not() -> None:
    had = take(0.3)
    assert had["had"] == "DEADLINE 30 % of a core"
    assert had["refused"] == ["fifo: refused here"]
    assert had["before"] == os.SCHED_OTHER, "until it is ready the process is ordinary"
    (own, other) = had["threads"]
    assert own[1] == other[1] == scheduling.DEADLINE
    assert own[5] / own[7] == pytest.approx(0.3)
    assert other[5] / other[7] == pytest.approx(0.01)
    assert had["cores"] == had["all"], "the kernel refuses it to a thread that is pinned"
    assert had["child"] == [os.SCHED_OTHER, 0]


@needs_deadline
@pytest.mark.parametrize(("asked_ns", "period_ns"), [(0, 1_000_000), (250_000, 1_000_000), (20_000_000, 20_000_000)])
def test_a_slow_loop_has_its_share_in_one_piece_and_later_deadlines(asked_ns: int, period_ns: int) -> None:
    had = take(0.1, period_ns=asked_ns)
    assert [thread[5:] for thread in had["threads"]] == [
        [pytest.approx(0.1 * period_ns), period_ns, period_ns],
        [10_000, 1_000_000, 1_000_000],  # ZeroMQ's, whatever the loop's
    ]


@pytest.mark.parametrize(
    ("policy", "flags", "yields"),
    [
        pytest.param(scheduling.DEADLINE, 1 | 2, 0, marks=needs_deadline),
        pytest.param(os.SCHED_OTHER, 0, 1),
        pytest.param(os.SCHED_OTHER, 1, 1, marks=needs_nice),
    ],
)
def test_who_steps_aside_never_gives_up_a_deadline_threads_budget(policy: int, flags: int, yields: int) -> None:
    """The kernel takes a yield of such a thread as the end of its work: it is not run before its next period."""
    runtime_ns = 300_000 if policy == scheduling.DEADLINE else 0
    script = _ASIDE.format(policy=policy, flags=flags, runtime_ns=runtime_ns)
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )
    assert done.stdout.strip() == str(yields), done.stderr


@needs_deadline
@needs_nice
def test_where_nothing_is_left_to_reserve_the_next_rung_is_taken() -> None:
    with subprocess.Popen(
        [sys.executable, "-c", _GREEDY], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline()
        had = take(0.6)
        holder.kill()
    assert had["had"].startswith("nice -20")
    assert had["refused"][1].startswith("deadline: no room")


#: A loop whose ticks take 0.3 ms of a core, of which 0.7 are reserved at first; then what it reserves.
_LOOP = """
import json, logging, tempfile, time
from pathlib import Path
from trocar.services.runtime.realtime import scheduling
from trocar.services.runtime.loop.loop import LoopMeter, ticks
from trocar.services.runtime.loop.reservation_keeper import ReservationKeeper, ReservationPause
from trocar.services.runtime.realtime.scheduling import Scheduling, SchedulingRequest, get_attributes

asked = Scheduling.request(SchedulingRequest(80, {share}, rungs=("deadline", "nice")))
meter = LoopMeter(1000.0)
asked.resume(period_ns=meter.period_ns)
had = [asked.had]
keeper = ReservationKeeper(asked, meter, ReservationPause(Path(tempfile.mkdtemp())), logging.getLogger())
for tick in ticks(meter, lambda: meter.ticks + meter.skipped > 2500):
    until_ns = time.thread_time_ns() + 300_000
    while time.thread_time_ns() < until_ns:
        pass
    keeper.keep()
    if asked.had != had[-1]:
        had.append(asked.had)
_, policy, *_, runtime_ns, _, period_ns = get_attributes(0)
print(json.dumps([policy, runtime_ns / period_ns, had, asked.refused]))
"""
#: Refuses the first reservation as a full machine does.
_NO_ROOM_AT_FIRST = """
import errno
admit, asks = Scheduling._deadline, []
def refuse_first(self, reset):
    asks.append(1)
    if len(asks) == 1:
        raise OSError(errno.EBUSY, scheduling._WHY[errno.EBUSY])
    return admit(self, reset)
Scheduling._deadline = refuse_first
"""


@needs_deadline
def test_a_loop_reserves_what_its_work_took() -> None:
    script = _LOOP.format(share=0.7)
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=PATIENCE_S, check=True
    )
    policy, share, had, refused = json.loads(done.stdout)
    assert policy == scheduling.DEADLINE
    assert 0.37 < share < 0.69, had
    assert (had[0], had[-1]) == ("DEADLINE 70 % of a core", f"DEADLINE {100 * share:.0f} % of a core")
    assert not refused


@needs_deadline
@needs_nice
def test_a_loop_that_found_no_room_comes_back_when_there_is() -> None:
    script = _LOOP.format(share=0.7).replace("asked.resume", _NO_ROOM_AT_FIRST + "asked.resume")
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=PATIENCE_S, check=True
    )
    policy, share, had, refused = json.loads(done.stdout)
    assert had[0].startswith("nice -20")
    assert had[-1] == f"DEADLINE {100 * share:.0f} % of a core"
    assert policy == scheduling.DEADLINE
    assert not refused


def test_a_thread_that_ends_meanwhile_is_no_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """A start failed by it: the thread ended between the look at the list and the call."""
    ended = int(subprocess.run(["sh", "-c", "echo $$"], capture_output=True, text=True, check=True).stdout)
    monkeypatch.setattr(scheduling, "own_threads", lambda: [ended])
    scheduling._make_ordinary(0)


@needs_nice
def test_without_both_all_threads_are_before_all_others_and_on_their_core() -> None:
    had = take(more=NO_DEADLINE)
    assert had["had"].startswith("nice -20")
    assert [thread[1:4:2] for thread in had["threads"]] == [[os.SCHED_OTHER, -20]] * 2
    assert had["cores"] == 1


@needs_nice
def test_what_a_supervisor_starts_is_ordinary_whatever_it_has_itself() -> None:
    assert take(more=NO_DEADLINE, alone=True)["child"] == [os.SCHED_OTHER, 0]


def test_a_machine_that_grants_nothing_is_told_in_one_fact() -> None:
    fact = realtime.scheduling_fact(
        Scheduling(SchedulingRequest(80, 0.3), refused=["fifo: not here", "nice: not here"], _rung=3)
    )
    assert (fact.asked, fact.ok) == ("FIFO 80", False)
    assert fact.had == "OTHER; fifo: not here; nice: not here"


def test_a_groups_budget_smaller_than_the_loops_share_is_not_taken(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A group that has used its budget up stands still for the rest of the second: worse than any other class."""
    monkeypatch.setattr(scheduling, "group_budget", lambda: 0.1)
    with pytest.raises(OSError, match=r"its group has 10 % of a core, 70 needed"):
        Scheduling(SchedulingRequest(80, 0.7))._fifo(False)


@pytest.mark.parametrize("path", sorted(RIGS.glob("*.yaml")), ids=lambda path: path.stem)
def test_what_the_loops_of_a_rig_reserve_is_admitted_by_two_cores(path: Path) -> None:
    """Who comes last and finds no room gets the next rung: a gateway with niceness alone ran at 962 to 980 Hz."""
    processes = load_rig(str(path)).processes
    loops = [each for each in processes.values() if each.priority is not None]
    runtime_ns, period_ns = scheduling.OFTEN_NS
    reserved = sum(each.share + 2 * runtime_ns / period_ns for each in loops)  # and ZeroMQ's two threads
    assert len(loops) == 4
    assert reserved + drive_process.SHARE <= 2 * scheduling.ADMITTED


def test_drives_reserve_a_share_of_their_own_period(monkeypatch: pytest.MonkeyPatch) -> None:
    """They have it in one piece: of a millisecond it was, and what a tick took beyond that waited for the next."""
    place, signals = Mock(spec=Scheduling), signal.getsignal(signal.SIGINT)
    monkeypatch.setattr(drive_process.realtime, "set_up", lambda *_given, share: ([], place))
    monkeypatch.setattr(drive_process.realtime, "freeze_garbage_collector", lambda: None)
    monkeypatch.setattr(drive_process, "_release_scheduling", lambda: None)
    monkeypatch.setattr(drive_process, "Drives", lambda _gateway: Mock(obey=lambda: False))  # ends at once
    monkeypatch.setattr(drive_process, "socket", Mock())
    monkeypatch.setattr(drive_process.sys, "stdin", Mock())
    drive_process.main(None, 5)
    signal.signal(signal.SIGINT, signals)
    place.resume.assert_called_once_with(period_ns=2_000_000)


def test_the_groups_budget_is_found_under_its_name_or_as_the_root_of_a_container(tmp_path: Path) -> None:
    mount, of = tmp_path / "cpu", tmp_path / "cgroup"
    of.write_text("4:memory:/a\n2:cpu,cpuacct:/rig/physics\n0::/\n")
    assert scheduling._group_folders(mount, of) == [mount / "rig/physics", mount]
    assert scheduling._group_folders(mount, tmp_path / "none") == [mount]
