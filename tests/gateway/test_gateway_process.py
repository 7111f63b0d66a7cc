from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.gateway.rig_bench import FORCE_N, RATE_LIMIT_N_S, Bench, assert_never_a_kick, forces, is_felt
from tests.patience import PATIENCE_S
from trocar.services.messages.exit_codes import ExitCode

TTL_S = 0.02


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    rig = Bench(tmp_path)
    yield rig
    rig.close()


def test_a_frozen_and_a_dead_haptics_leave_a_limp_arm_and_force_comes_back_by_engagement(bench: Bench) -> None:
    bench.gateway()
    haptics = bench.haptics(FORCE_N)
    bench.until(is_felt)
    os.kill(haptics.pid, signal.SIGSTOP)
    _assert_goes_limp(bench)
    os.kill(haptics.pid, signal.SIGCONT)
    bench.until(lambda i: i.state == "engaging")
    bench.until(is_felt)
    haptics.kill()
    _assert_goes_limp(bench)
    haptics.wait()
    bench.haptics(FORCE_N)
    bench.until(lambda i: i.state == "engaging")
    bench.until(is_felt)
    assert_never_a_kick(bench.frames)


def _assert_goes_limp(bench: Bench) -> None:
    first = len(bench.frames)
    bench.until(lambda i: i.model_age_s >= TTL_S)
    bench.hear(150)
    stale = [frame for frame in bench.frames[first:] if frame.body.instruments[0].model_age_s >= TTL_S]
    assert len(stale) > 150
    assert {frame.body.instruments[0].state for frame in stale} == {"stale"}
    # A tick that itself came late finds force that should be gone, and takes it back at the rate limit.
    np.testing.assert_array_equal(forces(stale[round(FORCE_N / RATE_LIMIT_N_S * 1e3) :]), 0.0)


def test_a_safe_stop_is_limp_until_armed_and_a_gateway_ends_when_asked(bench: Bench) -> None:
    gateway = bench.gateway()
    bench.haptics(FORCE_N)
    bench.until(is_felt)
    bench.tell(safe_stop=True)
    bench.until(lambda i: i.state == "ready")
    stopped = forces(bench.hear(200))
    np.testing.assert_array_equal(stopped[50:], 0.0)
    bench.tell(safe_stop=False)
    bench.until(lambda i: i.state == "active")
    bench.until(is_felt)
    gateway.terminate()
    assert gateway.wait(PATIENCE_S) == 0
    bench.until(lambda i: not any(i.applied_force_n))  # let go at the rate limit, not dropped
    assert_never_a_kick(bench.frames)
    said: list[str] = []
    while "stopping" not in said:  # what it said last may still be on its way
        assert bench.bus.wait("gateway.health", time.monotonic_ns() + 20_000_000_000), said
        said += [frame.body.state for frame in bench.bus.drain("gateway.health")]


def test_a_bad_rig_file_is_one_sentence(bench: Bench, capfd: pytest.CaptureFixture[str]) -> None:
    text = bench.rig_file.read_text().replace("phantom_simulated", "phantom_unheard_of")
    bench.rig_file.write_text(text)
    assert bench.gateway().wait(120) == ExitCode.USAGE
    error = capfd.readouterr().err
    assert "gateway: instrument 'left': there is no driver 'phantom_unheard_of'; known:" in error
    assert "Traceback" not in error


def test_a_gateway_that_hangs_or_dies_is_let_go_by_the_drive(tmp_path: Path) -> None:
    grasp = {"driver": "grasp_simulated", "device": "grasp_odrive", "settings": {"recording": "none"}}
    bench = Bench(tmp_path, grasp)
    try:
        gateway = bench.gateway()
        bench.haptics(0.2)
        bench.until(lambda i: i.applied_grasp_torque_nm > 0.04)
        os.kill(gateway.pid, signal.SIGSTOP)
        time.sleep(0.4)
        os.kill(gateway.pid, signal.SIGCONT)
        bench.until(lambda i: "WATCHDOG_TIMER_EXPIRED" in i.fault)
        bench.until(lambda i: i.applied_grasp_torque_nm > 0.04 and not i.fault)
        assert_never_a_kick(bench.frames)
        (drives,) = Path(f"/proc/{gateway.pid}/task/{gateway.pid}/children").read_text().split()
        gateway.kill()
        gateway.wait()
        _assert_ends(int(drives))
    finally:
        bench.close()


def _assert_ends(pid: int) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
    while _lives(pid):
        assert time.monotonic() < deadline_s, "the drives end with their gateway"
        time.sleep(0.01)


def _lives(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().split()[2] != "Z"
    except (FileNotFoundError, ProcessLookupError):  # it may end while it is read of
        return False
