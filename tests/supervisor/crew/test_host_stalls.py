"""The host stands still for 50 ms again and again, as a thread above all others makes it: no quality is given up."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace

import pytest

from tests.real_time import fifo_is_granted
from tests.supervisor.fakes import Fakes, Scenario, until, until_running
from trocar.services.supervisor.control.supervisor import Supervisor

#: It takes every core from whatever runs beside it, and is judged by what a core had left.
pytestmark = pytest.mark.rig

#: A governor that held the stalls for work would lower the quality once they had stood for so long.
SUDDEN_S = 1.0
LASTS_S = 3.5
#: Takes its core for 50 ms of each half second.
HOG = """
import os, sys, time
os.sched_setaffinity(0, {int(sys.argv[1])})
os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(99))
while True:
    time.sleep(0.5 - time.monotonic() % 0.5)
    until = time.monotonic() + 0.05
    while time.monotonic() < until: pass
"""


@pytest.fixture
def stalls() -> Iterator[list[subprocess.Popen[bytes]]]:
    """Have the stalls of each core ready, stopped."""
    if not fifo_is_granted():
        pytest.skip("takes the right to a priority above everybody")
    made = [subprocess.Popen([sys.executable, "-c", HOG, str(core)]) for core in os.sched_getaffinity(0)]
    for each in made:
        each.send_signal(signal.SIGSTOP)
    yield made
    for each in made:
        each.kill()
        each.wait()


@pytest.mark.usefixtures("soon")
def test_the_governor_does_not_act_where_the_host_stands_still(
    fakes: Fakes, stalls: list[subprocess.Popen[bytes]]
) -> None:
    """A stall of 49 ms lowered the quality of a rig that had time enough."""
    contract = "contracts={loops: {physics: {rate_hz: 200, miss_ratio: 0.001}}}"
    pinned = f"processes={{physics: {{core: {min(os.sched_getaffinity(0))}}}}}"  # else it goes where the host runs
    fakes = replace(fakes, options=replace(fakes.options, overrides=(contract, pinned)))
    lost: list[tuple[int, int]] = []

    def scenario(supervisor: Supervisor) -> Scenario:
        supervisor.enforcement.ladder = replace(supervisor.enforcement.ladder, sudden_s=SUDDEN_S)
        yield from until_running(supervisor)
        assert supervisor.enforcement.governor.can_lower, "there is something that could be given up"
        for each in stalls:
            each.send_signal(signal.SIGCONT)
        ends_s = time.monotonic() + LASTS_S
        yield from until(lambda: time.monotonic() > ends_s)
        health = supervisor.crew.members["physics"].health
        assert health is not None
        assert health.loop is not None
        lost.append((health.loop.misses, health.loop.beyond_work))
        assert supervisor.enforcement.governor.lowered == 0

    fakes.play(scenario)
    ((misses, beyond_work),) = lost
    assert misses > 50, "the contract was broken"
    assert beyond_work > 0.9 * misses
