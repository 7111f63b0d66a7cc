from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import can
import numpy as np
import pytest

from services.gateway import canbus, cansimple
from services.gateway.cansimple import AxisError
from services.gateway.drivers import grasp_simulated
from tests.gateway.rig_bench import RATE_LIMIT_N_S, Bench, assert_never_a_kick, forces

pytestmark = pytest.mark.rig

FORCE_N = 2.0
TTL_S = 0.02


def _felt(instrument: Any) -> bool:
    return bool(np.linalg.norm(instrument.applied_force_n) > 0.99 * FORCE_N)


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    rig = Bench(tmp_path)
    yield rig
    rig.close()


def test_a_frozen_and_a_dead_haptics_leave_a_limp_arm_and_force_comes_back_by_engagement(bench: Bench) -> None:
    bench.gateway()
    haptics = bench.haptics(FORCE_N)
    bench.until(_felt)
    os.kill(haptics.pid, signal.SIGSTOP)
    _assert_goes_limp(bench)
    os.kill(haptics.pid, signal.SIGCONT)
    bench.until(lambda i: i.state == "engaging")
    bench.until(_felt)
    haptics.kill()
    _assert_goes_limp(bench)
    haptics.wait()
    bench.haptics(FORCE_N)
    bench.until(lambda i: i.state == "engaging")
    bench.until(_felt)
    assert_never_a_kick(bench.frames)


def _assert_goes_limp(bench: Bench) -> None:
    heard = bench.listen(0.4)
    stale = [frame for frame in heard if frame.body.instruments[0].model_age_s >= TTL_S]
    assert len(stale) > 100
    assert {frame.body.instruments[0].state for frame in stale} == {"stale"}
    # A tick that itself came late finds force that should be gone, and takes it back at the rate limit.
    np.testing.assert_array_equal(forces(stale[round(FORCE_N / RATE_LIMIT_N_S * 1e3) :]), 0.0)


def test_a_safe_stop_is_limp_until_armed_and_a_gateway_ends_when_asked(bench: Bench) -> None:
    gateway = bench.gateway()
    bench.haptics(FORCE_N)
    bench.until(_felt)
    bench.tell(safe_stop=True)
    bench.until(lambda i: i.state == "ready")
    stopped = forces(bench.listen(0.4))
    assert len(stopped) > 150
    np.testing.assert_array_equal(stopped[50:], 0.0)
    bench.tell(safe_stop=False)
    bench.until(lambda i: i.state == "active")
    bench.until(_felt)
    gateway.terminate()
    assert gateway.wait(10) == 0
    np.testing.assert_array_equal(forces(bench.listen(0.1))[-1], 0.0)  # let go at the rate limit, not dropped
    assert_never_a_kick(bench.frames)
    frame = bench.bus.latest("gateway.health")
    assert frame is not None
    assert frame.body.state == "stopping"


def test_a_bad_rig_file_is_one_sentence(bench: Bench, capfd: pytest.CaptureFixture[str]) -> None:
    text = bench.rig_file.read_text().replace("phantom_simulated", "phantom_unheard_of")
    bench.rig_file.write_text(text)
    assert bench.gateway().wait(30) == 4
    error = capfd.readouterr().err
    assert "gateway: instrument 'left': there is no driver 'phantom_unheard_of'; known:" in error
    assert "Traceback" not in error


class Sniffer:
    """Listens on the simulated drive's bus."""

    def __init__(self, settings: dict[str, Any]) -> None:
        self._bus = canbus.open_bus(settings, "test")

    def errors(self) -> set[int]:
        heartbeats = [m for m in self._heard() if m.arbitration_id == cansimple.identifier(1, cansimple.HEARTBEAT)]
        return {cansimple.unpack_heartbeat(bytes(message.data))[0] for message in heartbeats}

    def is_silent(self) -> bool:
        self._heard()
        time.sleep(0.3)
        return not self._heard()

    def _heard(self) -> list[can.Message]:
        heard = list(canbus.drain(self._bus))
        return heard + self._heard() if heard else heard

    def close(self) -> None:
        self._bus.shutdown()


def test_a_gateway_that_hangs_or_dies_is_let_go_by_the_drive(tmp_path: Path, multicast: None) -> None:
    bus = grasp_simulated.private_bus()
    settings = {"recording": "none", "bus": bus}
    bench = Bench(tmp_path, {"driver": "grasp_simulated", "device": "grasp_odrive", "settings": settings})
    sniffer = Sniffer(bus)
    try:
        gateway = bench.gateway()
        bench.haptics(0.2)
        bench.until(lambda i: i.applied_grasp_torque_nm > 0.04)
        sniffer.errors()
        os.kill(gateway.pid, signal.SIGSTOP)
        time.sleep(0.4)
        os.kill(gateway.pid, signal.SIGCONT)
        assert AxisError.WATCHDOG_TIMER_EXPIRED in sniffer.errors()
        bench.until(lambda i: i.applied_grasp_torque_nm > 0.04 and not i.fault)
        assert_never_a_kick(bench.frames)
        gateway.kill()
        gateway.wait()
        time.sleep(0.5)
        assert sniffer.is_silent(), "its drive ends with it"
    finally:
        sniffer.close()
        bench.close()


def test_a_host_without_multicast_is_told_the_route_and_runs_with_it(tmp_path: Path) -> None:
    if not shutil.which("ip") or subprocess.run(["unshare", "-n", "true"], check=False).returncode != 0:
        pytest.skip("this user may not make a network namespace")
    code = (
        "from services.gateway import canbus; from services.gateway.drivers import grasp_simulated\n"
        "canbus.open_bus(grasp_simulated.private_bus(), 'here').shutdown()"
    )
    script = 'ip link set lo up; "$0" -c "$1" 2>&1; ip route add 239.0.0.0/8 dev lo; "$0" -c "$1" && echo open'
    done = subprocess.run(
        ["unshare", "-n", "bash", "-c", script, sys.executable, code], check=True, capture_output=True, text=True
    )
    assert "`ip route add 239.0.0.0/8 dev lo` makes one" in done.stdout
    assert "not properly shut down" not in done.stdout
    assert done.stdout.splitlines()[-1] == "open"
