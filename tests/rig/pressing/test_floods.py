"""A loop that floods the bus and a disk that holds a write: said, borne, and nobody is ended for it."""

from __future__ import annotations

import os
import signal
import time

import pytest

from tests.patience import PATIENCE_S
from tests.rig.conftest import Rig
from tests.rig.faults import engage, force_n, force_rates_n_s, rate_limit_n_s

pytestmark = [pytest.mark.rig, pytest.mark.timeout(600)]


def test_floods_and_a_slow_disk_are_in_the_history_and_harm_nobody(rig: Rig) -> None:
    engage(rig)
    before = rig.observer.pids()
    _misbehave(rig, {"gateway": "gateway: floods ", "recorder": "recorder: WARNING the disk has held a write for "})
    _misbehave(rig, {loop: f"{loop}: floods " for loop in ("haptics", "physics")})
    rig.observer.until(lambda: rig.observer.is_up, PATIENCE_S, "running")
    assert rig.observer.pids() == before
    assert max(force_rates_n_s(rig.observer.samples)) <= rate_limit_n_s()
    rig.observer.until(lambda: force_n(rig.observer.samples[-1]) > 0.02, PATIENCE_S, "a force at the left hand")


def _misbehave(rig: Rig, told: dict[str, str]) -> None:
    """Let processes misbehave, and wait until each is told of and all is over."""
    for process in told:
        os.kill(rig.observer.pids()[process], signal.SIGUSR1)
    began, log = time.monotonic(), rig.directory / "log"
    for text in told.values():
        rig.observer.until(lambda text=text: text in log.read_text(errors="replace"), 60.0, text)
    rig.observer.until(lambda: time.monotonic() - began > 0.6, PATIENCE_S, "its end")
