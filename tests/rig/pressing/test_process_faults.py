"""Processes killed and stopped, on the real bus: the hand feels a fade, the rig mends itself.

Those in the way of the force, and the recorder, once by day; each with either signal in the long run, and by chance
in `tests.proofs.faults`.
"""

from __future__ import annotations

import os
import re
import signal

import pytest

from tests.obeyed import until_obeyed
from tests.patience import PATIENCE_S
from tests.rig.conftest import Rig
from tests.rig.faults import FAULTS, drives_of, engage, force_n, force_rates_n_s, rate_limit_n_s, strike
from trocar.protocol.bodies import GatewayState
from trocar.services.cli.arm import page_of, run_command, state_at
from trocar.services.cli.attempt import run_order
from trocar.services.runtime.config.config import load_rig

pytestmark = [pytest.mark.rig, pytest.mark.timeout(600)]

BY_DAY = [
    ("haptics", signal.SIGSTOP),
    ("physics", signal.SIGKILL),
    ("gateway", signal.SIGKILL),
    ("recorder", signal.SIGKILL),
]


def test_an_attempt_begins_again_stands_and_goes_on_with_limp_arms_and_without_a_kick(rig: Rig) -> None:
    """In the whole rig, by the command line's way: through page, supervisor, training process and gateway."""
    observer, overrides = rig.observer, (f"transport.directory={rig.directory / 'bus'}",)

    def ask(what: str, value: float = 0.0) -> None:
        until_obeyed(lambda: run_order("stub", overrides, what, value))

    engage(rig)
    del observer.samples[:-50]
    ask("new")
    observer.until(lambda: observer.samples[-1].begins == 1, PATIENCE_S, "the scene begins again")
    began = next(k for k, sample in enumerate(observer.samples) if sample.begins)
    assert force_n(observer.samples[began]) == 0.0, "hands are put back only without force"
    assert force_n(observer.samples[0]) > 0.0
    observer.until(lambda: force_n(observer.samples[-1]) > 0.02, PATIENCE_S, "a force at the left hand")
    ask("pause")
    observer.until(lambda: observer.samples[-1].tick == observer.samples[-30].tick, PATIENCE_S, "time stands")
    stands = observer.samples[-1].tick
    assert not any(force_n(sample) for sample in observer.samples if sample.tick == stands)
    ask("step", 7)
    observer.until(lambda: observer.samples[-1].tick == stands + 7, PATIENCE_S, "seven ticks more")
    ask("resume")
    observer.until(lambda: force_n(observer.samples[-1]) > 0.02, PATIENCE_S, "a force at the left hand again")
    rates_n_s = force_rates_n_s(observer.samples)
    assert len(rates_n_s) > 500
    assert max(rates_n_s) <= rate_limit_n_s()
    assert observer.samples[-1].begins == 1


@pytest.mark.parametrize(
    ("name", "number"),
    [
        pytest.param(*each, id=f"{each[0]}-{each[1].name}", marks=[pytest.mark.long] * (each not in BY_DAY))
        for each in FAULTS
    ],
)
def test_a_process_that_dies_or_hangs(rig: Rig, name: str, number: signal.Signals) -> None:
    strike(rig, name, number)


def test_dead_drives_stand_in_the_history_and_arming_the_rig_at_once_brings_them_back(rig: Rig) -> None:
    """They are the gateway's own, not the supervisor's: nobody restarts them unasked, and force goes on."""
    observer, overrides = rig.observer, (f"transport.directory={rig.directory / 'bus'}",)
    address = page_of(load_rig("stub", overrides))
    engage(rig)
    before, killed_s = observer.pids(), state_at(address)["t"]
    (dead,) = drives_of(before["gateway"])
    os.kill(dead, signal.SIGKILL)
    gone = r"the grasp drive \(node {}\): CAN: the emulated drive does not listen.*"
    sentence = re.compile("gateway: .*left: " + gone.format(1) + "right: " + gone.format(2))

    def is_told() -> bool:
        events = state_at(address)["events"]
        return any(each["t"] >= killed_s and sentence.match(each["text"]) for each in events)

    observer.until(is_told, PATIENCE_S, "both drives in the history")
    assert not drives_of(before["gateway"])
    assert observer.pids() == before
    until_obeyed(lambda: run_command("arm", "stub", overrides, None, None))
    devices = observer.devices = []
    try:
        observer.until(lambda: len(devices) > 100 and _are_well(devices[-100:]), PATIENCE_S, "handles without a fault")
    finally:
        observer.devices = None
    assert drives_of(before["gateway"])
    engage(rig)
    assert observer.pids() == before


def _are_well(devices: list[GatewayState]) -> bool:
    return not any(each.fault for state in devices for each in state.instruments)
