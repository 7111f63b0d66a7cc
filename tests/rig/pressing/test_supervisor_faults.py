"""The supervisor stopped for a moment: the hand does not notice. Killed: it is let go, as nobody could stop the rig.

Nothing of the rig of this folder runs after that.
"""

from __future__ import annotations

import itertools
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.patience import PATIENCE_S
from tests.rig.conftest import Rig
from tests.rig.faults import engage, force_n, force_rates_n_s, rate_limit_n_s
from tests.rig.pressing.conftest import TIMEOUT_S
from trocar.services.supervisor.crew.processes import TABLE

pytestmark = [pytest.mark.rig, pytest.mark.timeout(600)]

HELD_TICKS = 700  # longer than a heartbeat may be missing
TTL_S = 0.020
SOON_S = 3.5


def test_without_its_supervisor_the_rig_lets_go_and_waits_until_somebody_ends_it(rig: Rig) -> None:
    engage(rig)
    before = rig.observer.pids()
    assert len(before) == len(TABLE)
    _stop_for_a_while(rig)
    rig.observer.until(lambda: rig.observer.states[-1][0] > time.monotonic_ns() - 10**9, PATIENCE_S, "a word from it")
    assert rig.observer.pids() == before, "its own stall counts against nobody"

    rig.observer.samples.clear()
    os.kill(rig.process.pid, signal.SIGKILL)
    killed_ns = time.monotonic_ns()
    rig.process.wait(PATIENCE_S)
    _assert_hands_are_let_go(rig, killed_ns)
    assert all(Path(f"/proc/{pid}").exists() for pid in before.values())

    down = [sys.executable, "-c", "from trocar.services.cli.app import main; main()", "down", "--json"]
    command = [*down, "--set", f"transport.directory={rig.directory / 'bus'}"]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=300, check=True)
    assert all(name in ended.stdout for name in before)
    assert not any(_lives(pid) for pid in before.values())


def _stop_for_a_while(rig: Rig) -> None:
    os.kill(rig.process.pid, signal.SIGSTOP)
    try:
        _assert_force_goes_on(rig)
    finally:
        os.kill(rig.process.pid, signal.SIGCONT)


def _assert_force_goes_on(rig: Rig) -> None:
    """For a while the gateway ticks, and what the hand feels neither ends nor jumps."""
    samples = rig.observer.samples
    samples.clear()
    rig.observer.until(
        lambda: bool(samples) and samples[-1].tick - samples[0].tick >= HELD_TICKS,
        PATIENCE_S,
        "ticks of the gateway",
    )
    assert len({sample.incarnation for sample in samples}) == 1
    ticks = [sample.tick for sample in samples]
    assert all(b > a for a, b in itertools.pairwise(ticks))
    assert max(force_rates_n_s(samples)) <= rate_limit_n_s()
    assert any(sample.state == "active" for sample in samples)
    left = [b for a, b in itertools.pairwise(samples) if a.state == "active" != b.state]
    assert all(sample.model_age_s >= TTL_S for sample in left), "but for models that the machine keeps for too long"


def _assert_hands_are_let_go(rig: Rig, killed_ns: int) -> None:
    """Nobody could stop the rig any more: the gateway ticks on, and force fades within its time."""
    samples = rig.observer.samples

    def let_go() -> bool:  # for good: a stream of models that was late for a moment is engaged again after 0.1 s
        last = samples[-500:]
        return len(last) == 500 and all(sample.state == "stale" for sample in last)

    rig.observer.until(let_go, TIMEOUT_S + 60.0, "let go")
    assert len({sample.incarnation for sample in samples}) == 1
    last = max((sample.sent_ns for sample in samples if sample.state != "stale"), default=killed_ns)
    assert last - killed_ns < round((TIMEOUT_S + SOON_S) * 1e9)
    assert max(force_n(sample) for sample in samples[-100:]) == 0.0
    assert max(force_rates_n_s(samples)) <= rate_limit_n_s()


def _lives(pid: int) -> bool:
    stat = Path(f"/proc/{pid}/stat")
    return stat.exists() and stat.read_text().rpartition(")")[2].split()[0] != "Z"
