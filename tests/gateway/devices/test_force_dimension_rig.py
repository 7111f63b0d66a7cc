"""A gateway process with an omega.7 on the stand-in of Force Dimension's library, in real time."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.gateway.devices.bench import BenchUnavailable
from tests.gateway.devices.dhd_library import DhdStandIn
from tests.gateway.rig_bench import Bench, assert_never_a_kick

FORCE_N = 1.0


def _felt(instrument: Any) -> bool:
    return bool(np.linalg.norm(instrument.applied_force_n) > 0.99 * FORCE_N)


def _is_out(instrument: Any) -> bool:
    return instrument.state == "fault" and not any(instrument.applied_force_n)


def test_an_arm_of_the_library_bears_the_law_and_survives_its_faults(tmp_path: Path) -> None:
    folder = tmp_path / "library"
    folder.mkdir()
    try:
        with DhdStandIn.compiled(folder) as standin:
            library = str(standin.path)
    except BenchUnavailable as reason:
        pytest.skip(str(reason))
    arm = {"driver": "force_dimension", "device": str(tmp_path / "device.yaml"), "settings": {"library": library}}
    bench = Bench(tmp_path, arms={"left": arm})
    arguments = (library, "--rig", str(bench.rig_file))
    gateway = bench.start("tests.gateway.hdapi.gateway_on_standin", *arguments, stdin=subprocess.PIPE)
    assert gateway.stdin is not None
    try:
        gateway.stdin.write(b"reset 1\n")
        gateway.stdin.flush()
        bench.haptics(FORCE_N)
        bench.tell(safe_stop=False, armed=1)
        bench.until(_felt)
        bench.hear(2000)
        for armed, (fault, cure) in enumerate(
            (("plug 0 0", "plug 0 1"), ("fail 1", "fail 0"), ("hang 700", "hang 0")), 2
        ):
            gateway.stdin.write(f"{fault}\n".encode())
            gateway.stdin.flush()
            bench.until(_is_out)
            gateway.stdin.write(f"{cure}\n".encode())
            gateway.stdin.flush()
            bench.tell(safe_stop=False, armed=armed)
            bench.until(_felt)
        assert_never_a_kick(bench.frames)
        health = bench.bus.latest("gateway.health")
        assert health is not None
        assert health.body.gauges["servo_rate_hz.left.arm"] > 100.0
    finally:
        bench.close()
        gateway.stdin.close()
