"""Stopped, starved or hanging: three silences that the kernel tells apart."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.patience import PATIENCE_S
from tests.real_time import fifo_is_granted
from trocar.services.supervisor.crew import runqueue_waits
from trocar.services.supervisor.crew.runqueue_waits import BusWaits, ThreadWait
from trocar.services.supervisor.crew.scheduler_state import SchedulerState

SPIN = "print(1, flush=True)\nwhile True: pass"
#: Takes its core from everybody of the ordinary class until its file is there, or somebody has forgotten it.
HOG = """
import os, sys, time
os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
print("on", flush=True)
until = time.monotonic() + 60.0
while time.monotonic() < until and not os.path.exists(sys.argv[1]): pass
"""


@contextmanager
def running(program: str, *arguments: str, core: int) -> Iterator[subprocess.Popen[bytes]]:
    command = ["taskset", "-c", str(core), sys.executable, "-I", "-S", "-c", program, *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        try:
            yield process
        finally:
            process.kill()


@pytest.fixture
def cores() -> Iterator[tuple[int, int]]:
    """Return two cores, the test itself on the first."""
    mine = os.sched_getaffinity(0)
    if len(mine) < 2 or not fifo_is_granted():
        pytest.skip("takes two cores, and the right to starve somebody on one of them")
    first, second = sorted(mine)[:2]
    os.sched_setaffinity(0, {first})
    yield first, second
    os.sched_setaffinity(0, mine)


def until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline, "it did not happen"
        time.sleep(1e-3)


def until_it_runs(process: subprocess.Popen[bytes]) -> SchedulerState:
    """Return what the kernel says of a process that spins, from when it does."""
    assert process.stdout is not None
    process.stdout.readline()
    return SchedulerState(process.pid)


def before_it_ran_again(process: subprocess.Popen[bytes], look: Callable[[], object]) -> object:
    """Return what a look finds of a process that others starve, in a time in which the kernel has given it nothing.

    A class that takes its core for ever has it taken for a twentieth of each second.
    """
    schedule = Path(f"/proc/{process.pid}/schedstat")
    deadline = time.monotonic() + PATIENCE_S
    while True:
        assert time.monotonic() < deadline, "it is not starved"
        before = schedule.read_text()
        found = look()
        if schedule.read_text() == before:
            return found


def test_a_starved_process_waits_and_a_stop_signal_that_it_has_yet_to_take_is_known(
    cores: tuple[int, int], tmp_path: Path
) -> None:
    enough = tmp_path / "enough"
    with running(SPIN, core=cores[1]) as victim, running(HOG, str(enough), core=cores[1]) as hog:
        word = until_it_runs(victim)
        assert hog.stdout is not None
        hog.stdout.readline()

        def waited_s() -> float:
            word.is_stopped()
            before_s = word.waits().total_s
            time.sleep(0.05)
            assert not word.is_stopped(), "it would run if it could"
            return word.waits().total_s - before_s

        assert before_it_ran_again(victim, waited_s) >= 0.04, "the wait is known while it goes on"  # type: ignore[operator]

        def stop() -> tuple[bool, bytes]:
            os.kill(victim.pid, signal.SIGCONT)
            os.kill(victim.pid, signal.SIGSTOP)
            return word.is_stopped(), word._state()

        assert before_it_ran_again(victim, stop) == (True, b"R"), "it cannot even stop, but it will"
        enough.touch()
        until(lambda: word._state() == b"T")
        assert word.is_stopped()
        os.kill(victim.pid, signal.SIGCONT)
        until(lambda: not word.is_stopped())
        word.close()


def test_a_process_that_sleeps_for_good_waits_for_nobody() -> None:
    with running("import time; print(1, flush=True); time.sleep(60)", core=min(os.sched_getaffinity(0))) as process:
        assert process.stdout is not None
        process.stdout.readline()
        word = SchedulerState(process.pid)
        until(lambda: word._state() == b"S")
        before_s = word.waits().total_s
        time.sleep(0.05)
        assert word.waits().total_s == before_s
        assert not word.is_stopped()
        process.kill()
        process.wait()
        assert not word.is_stopped(), "of one that has ended nothing is said"
        assert word.waits().total_s == 0.0
        word.close()


#: Begins a thread of this name when it is asked to, which computes beside a main thread that sleeps.
SPINNER = """
import sys, threading, time
def spin():
    open(f"/proc/self/task/{threading.get_native_id()}/comm", "w").write(sys.argv[1])
    print(threading.get_native_id(), flush=True)
    while True: pass
sys.stdin.readline()
threading.Thread(target=spin, daemon=True).start()
time.sleep(600)
"""


@pytest.mark.skipif(not Path("/proc/self/schedstat").exists(), reason="this kernel keeps no statistics of waits")
@pytest.mark.parametrize(("name", "counts"), [("ZMQbg/IO/0", True), ("compiler", False)])
def test_the_thread_that_sends_the_heartbeats_counts_from_when_it_is_there(name: str, counts: bool) -> None:
    core = min(os.sched_getaffinity(0))
    command = ["taskset", "-c", str(core), sys.executable, "-I", "-S", "-c", SPINNER, name]
    with running(SPIN, core=core), subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as victim:
        assert victim.stdin is not None
        assert victim.stdout is not None
        word = SchedulerState(victim.pid)
        word.waits()
        victim.stdin.write(b"\n")
        victim.stdin.flush()
        schedule = Path(f"/proc/{victim.pid}/task/{int(victim.stdout.readline())}/schedstat")

        def waited_s() -> float:
            return int(schedule.read_text().split()[1]) * 1e-9

        before_s, began_s = word.waits().bus_s, waited_s()
        until(lambda: waited_s() - began_s > 0.1)
        least_s = waited_s() - began_s
        counted_s = word.waits().bus_s - before_s
        victim.kill()
        word.close()
    if counts:
        assert counted_s >= least_s - 1e-6
    else:
        assert counted_s == pytest.approx(0.0, abs=1e-9)


def test_a_thread_of_the_bus_that_ended_keeps_what_it_waited_and_one_not_yet_named_is_looked_at_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    go = threading.Event()
    thread = threading.Thread(target=go.wait)
    thread.start()
    comm = Path(f"/proc/self/task/{thread.native_id}/comm")
    comm.write_text("ZMQbg/IO/0")
    tasks = os.open("/proc/self/task", os.O_RDONLY)
    monkeypatch.setattr(runqueue_waits, "_NAMED_AFTER_NS", 10**18)  # as if nobody had run for long enough
    waits = BusWaits(tasks)
    waits.waited_s()
    assert list(waits._threads) == [thread.native_id]
    assert waits._links == -1, "the others are looked at again"
    waits._threads[thread.native_id or 0]._waited_ns = 0
    monkeypatch.setattr(ThreadWait, "look", lambda self: setattr(self, "_waited_ns", 3_000_000_000))
    assert waits.waited_s() == 3.0
    go.set()
    thread.join()
    while comm.exists():
        time.sleep(1e-3)
    assert waits.waited_s() == 3.0
    assert not waits._threads
    waits.close()
    os.close(tasks)
