"""A gateway process with an omega.7 on the stand-in of Force Dimension's library, in real time."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.gateway.devices.bench import BenchUnavailable
from tests.gateway.devices.dhd_library import DhdStandIn
from tests.gateway.rig_bench import FORCE_N, Bench, active_share, assert_never_a_kick, is_felt, is_out


class Rig:
    """A gateway with an omega.7 on the stand-in, and a fake haptics."""

    def __init__(self, folder: Path) -> None:
        standin = folder / "library"
        standin.mkdir()
        try:
            with DhdStandIn.compiled(standin) as made:
                library = str(made.path)
        except BenchUnavailable as reason:
            pytest.skip(str(reason))
        arm = {"driver": "force_dimension", "device": str(folder / "device.yaml"), "settings": {"library": library}}
        self.bench = Bench(folder, arms={"left": arm})
        arguments = (library, "--rig", str(self.bench.rig_file))
        self.gateway = self.bench.start("tests.gateway.hdapi.gateway_on_standin", *arguments, stdin=subprocess.PIPE)
        self.tell_device("reset 1")
        self.bench.haptics(FORCE_N)

    def tell_device(self, line: str) -> None:
        assert self.gateway.stdin is not None
        self.gateway.stdin.write(f"{line}\n".encode())
        self.gateway.stdin.flush()

    def arm_until_felt(self, armed: int) -> None:
        self.bench.tell(safe_stop=False, armed=armed)
        self.bench.until(is_felt)

    def rate_hz(self) -> float:
        health = self.bench.bus.latest("gateway.health")
        assert health is not None
        return float(health.body.gauges["servo_rate_hz.left.arm"])

    def close(self) -> None:
        self.bench.close()
        assert self.gateway.stdin is not None
        self.gateway.stdin.close()


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[Rig]:
    built = Rig(tmp_path)
    yield built
    built.close()


def test_an_arm_of_the_library_bears_the_law_and_survives_its_faults(rig: Rig) -> None:
    bench = rig.bench
    rig.arm_until_felt(1)
    bench.hear(2000)
    faults = (("plug 0 0", "plug 0 1"), ("fail 1", "fail 0"), ("hang 700", "hang 0"))
    for armed, (fault, cure) in enumerate(faults, 2):
        rig.tell_device(fault)
        bench.until(is_out)
        rig.tell_device(cure)
        rig.arm_until_felt(armed)
    assert_never_a_kick(bench.frames)
    assert rig.rate_hz() > 100.0


@pytest.mark.long
@pytest.mark.timeout(1200)
def test_a_minute_with_the_library_has_no_fault_and_no_kick(rig: Rig) -> None:
    """How much of it a force was active depends on who else uses the machine: it is printed."""
    rig.arm_until_felt(1)
    frames = rig.bench.hear(60_000)
    assert_never_a_kick(frames)
    assert not any(frame.body.instruments[0].state == "fault" for frame in frames)
    share = active_share(frames)
    print(f"force active in {100.0 * share:.1f} % of {len(frames)} ticks, {rig.rate_hz():.0f} Hz")
    assert share > 0.0
