"""Stopped, starved or hanging: three silences that the kernel tells apart."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from services.supervisor.kernel_word import KernelWord

SPIN = "while True: pass"
STARVED_S = 0.2
#: Takes its core for a while, from everybody of the ordinary class.
HOG = """
import os, sys, time
os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
print("on", flush=True)
until = time.monotonic() + float(sys.argv[1])
while time.monotonic() < until: pass
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
    if len(mine) < 2 or os.geteuid() != 0:
        pytest.skip("takes two cores, and the right to starve somebody on one of them")
    first, second = sorted(mine)[:2]
    os.sched_setaffinity(0, {first})
    yield first, second
    os.sched_setaffinity(0, mine)


def until_it_runs(process: subprocess.Popen[bytes]) -> KernelWord:
    """Return what the kernel says of a process that spins, from when it does."""
    word = KernelWord(process.pid)
    deadline = time.monotonic() + 10.0
    while word._state() != b"R":
        assert time.monotonic() < deadline
        time.sleep(1e-3)
    return word


def test_a_starved_process_waits_and_a_stop_signal_that_it_has_yet_to_take_is_known(cores: tuple[int, int]) -> None:
    with running(SPIN, core=cores[1]) as victim:
        word = until_it_runs(victim)
        with running(HOG, str(STARVED_S), core=cores[1]) as hog:
            assert hog.stdout is not None
            hog.stdout.readline()
            word.is_stopped()
            before_s, began_s = word.waited_s(), time.monotonic()
            time.sleep(0.25 * STARVED_S)
            assert not word.is_stopped(), "it would run if it could"
            assert word.waited_s() - before_s > 0.1 * STARVED_S, "and the wait is known while it goes on"
            os.kill(victim.pid, signal.SIGSTOP)
            stopped, state = word.is_stopped(), word._state()
            if time.monotonic() - began_s < 0.7 * STARVED_S:  # else the hog may be done, and the test shows nothing
                assert (stopped, state) == (True, b"R"), "it cannot even stop, but it will"
        deadline = time.monotonic() + 5.0
        while word._state() != b"T":
            assert time.monotonic() < deadline
            time.sleep(1e-3)
        assert word.is_stopped()
        os.kill(victim.pid, signal.SIGCONT)
        while word.is_stopped():
            assert time.monotonic() < deadline
            time.sleep(1e-3)
        word.close()


def test_a_process_that_sleeps_for_good_waits_for_nobody() -> None:
    with running("import time; print(1, flush=True); time.sleep(60)", core=min(os.sched_getaffinity(0))) as process:
        assert process.stdout is not None
        process.stdout.readline()
        word = KernelWord(process.pid)
        deadline = time.monotonic() + 5.0
        while word._state() != b"S":
            assert time.monotonic() < deadline
            time.sleep(1e-3)
        before_s = word.waited_s()
        time.sleep(0.05)
        assert word.waited_s() == before_s
        assert not word.is_stopped()
        process.kill()
        process.wait()
        assert not word.is_stopped(), "of one that has ended nothing is said"
        assert word.waited_s() == 0.0
        word.close()
