"""A gateway process with an Inverse3 on a stand-in of Haply's service, a process beside it, in real time."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.gateway.kicks import kicks_n
from tests.gateway.rig_bench import FORCE_N, RATE_LIMIT_N_S, Bench, active_share, assert_never_a_kick, is_felt, is_out
from trocar.services.gateway.devices.limited_force import SPARE_S
from trocar.services.gateway.servo.servo_law import MAX_STEP_S


class Rig:
    """The gateway, a fake haptics, and the service; `armed` counts how often a person armed the rig."""

    def __init__(self, folder: Path) -> None:
        command = [sys.executable, "-m", "tests.gateway.devices.haply_service", "0"]
        self.service = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert self.service.stdout is not None
        settings = {"port": int(self.service.stdout.readline()), "id": "LEFT"}
        arm = {"driver": "haply", "device": str(folder / "device.yaml"), "settings": settings}
        self.bench = Bench(folder, arms={"left": arm})
        self.armed = 0

    def tell_service(self, line: str) -> None:
        assert self.service.stdin is not None
        self.service.stdin.write(line + "\n")
        self.service.stdin.flush()

    def arm_until_felt(self) -> None:
        self.armed += 1
        self.bench.tell(safe_stop=False, armed=self.armed)
        self.bench.until(is_felt)

    def gauges(self) -> dict[str, float]:
        frame = self.bench.bus.latest("gateway.health")
        assert frame is not None
        return dict(frame.body.gauges)

    def close(self) -> None:
        self.bench.close()
        self.service.kill()
        self.service.communicate()


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[Rig]:
    built = Rig(tmp_path)
    yield built
    built.close()


@pytest.mark.long
@pytest.mark.timeout(1200)
def test_a_minute_with_the_service_has_no_fault_and_no_kick(rig: Rig) -> None:
    """How much of it a force was active depends on who else uses the machine: it is printed."""
    bench = rig.bench
    bench.gateway()
    bench.haptics(FORCE_N)
    rig.arm_until_felt()
    frames = bench.hear(60_000)
    assert_never_a_kick(frames)
    assert not any(frame.body.instruments[0].state == "fault" for frame in frames)
    share = active_share(frames)
    print(
        f"force active in {100.0 * share:.1f} % of {len(frames)} ticks, {rig.gauges()['servo_rate_hz.left.arm']:.0f} Hz"
    )
    assert share > 0.0


def test_an_arm_of_the_service_bears_the_law_and_survives_its_faults(rig: Rig) -> None:
    bench = rig.bench
    bench.gateway()
    bench.haptics(FORCE_N)
    rig.arm_until_felt()
    bench.hear(2000)
    assert 100.0 < rig.gauges()["servo_rate_hz.left.arm"] < 1100.0
    for fault in ("plug 0", "hold 1", "spoil 1"):
        rig.tell_service(fault)
        bench.until(is_out)
        rig.tell_service(f"{fault.split()[0]} {1 - int(fault.split()[1])}")
        rig.arm_until_felt()
    assert_never_a_kick(bench.frames)
    said, _ = rig.service.communicate()
    forces = np.array(json.loads(said))[:, 0]
    assert np.linalg.norm(forces, axis=1).max() > 0.99 * FORCE_N
    kicks, most_n, idle = kicks_n(forces), RATE_LIMIT_N_S * (MAX_STEP_S + SPARE_S) + 1e-9, ~forces[:-1].any(axis=1)
    assert kicks[~idle].max() <= most_n
    # The service that was held found one force of before when it went on; nobody can take that back.
    assert (kicks[idle] > most_n).sum() <= 1
    assert kicks.max() <= FORCE_N + most_n
