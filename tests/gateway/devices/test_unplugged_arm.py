"""An arm that is pulled out of a whole gateway process, and plugged in again: stand-in of OpenHaptics, real bus."""

from __future__ import annotations

import itertools
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.gateway.devices.bench import BenchUnavailable
from tests.gateway.hdapi.hdapi_library import HdapiStandIn
from tests.gateway.rig_bench import RATE_LIMIT_N_S, Bench, forces
from tests.patience import PATIENCE_S

LEFT, RIGHT = 0, 1
#: A contact that pushes to and fro gives energy to a hand: so little here that the servo need not take it back.
FORCE_N, PERIOD_S = 1.0, 1.5
#: How soon a model is too old.
TTL_S = 0.02
#: An arm that is being opened stays so until it is told otherwise.
NOT_YET_MS = 600_000


class Unplugged:
    """Two arms in hands that touch something again and again; `armed` counts how often a person armed the rig."""

    def __init__(self, folder: Path, library: Path) -> None:
        arms = {
            name: {
                "driver": "phantom_hdapi",
                "device": str(folder / "device.yaml"),
                "settings": {"name": name.capitalize(), "library": str(library)},
            }
            for name in ("left", "right")
        }
        self.bench = Bench(folder, arms=arms)
        arguments = (str(library), "--rig", str(self.bench.rig_file))
        self.gateway = self.bench.start("tests.gateway.hdapi.gateway_on_standin", *arguments, stdin=subprocess.PIPE)
        self.bench.haptics(FORCE_N, PERIOD_S)
        self.bench.tell(safe_stop=False)
        self.armed = 0

    def hook(self, line: str) -> None:
        assert self.gateway.stdin is not None
        self.gateway.stdin.write(f"{line}\n".encode())
        self.gateway.stdin.flush()

    def arm_the_rig(self) -> None:
        self.armed += 1
        self.bench.tell(safe_stop=False, armed=self.armed)

    def until_felt(self, which: int) -> None:
        self.bench.until(lambda tool: float(np.linalg.norm(tool.applied_force_n)) > 0.6 * FORCE_N, which)


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[Unplugged]:
    try:
        with HdapiStandIn.compiled(tmp_path, threaded=True) as standin:
            library = standin.path
    except BenchUnavailable as reason:
        pytest.skip(str(reason))
    running = Unplugged(tmp_path, library)
    yield running
    assert running.gateway.stdin is not None
    running.gateway.stdin.close()
    running.bench.close()


def test_an_arm_that_is_pulled_out_of_a_running_gateway_comes_back_and_the_other_hand_goes_on(rig: Unplugged) -> None:
    bench = rig.bench
    for which in (LEFT, RIGHT):
        rig.until_felt(which)
    rig.hook("pull 1")
    bench.until(lambda tool: "the arm 'Left' reports HD_BAD_HANDLE" in tool.fault, LEFT)
    rig.until_felt(RIGHT)
    gone = len(bench.frames)  # with it went what it pushed, at once
    assert without_force(bench.hear(200), LEFT)

    rig.arm_the_rig()  # too early: it is not plugged in
    bench.until(lambda tool: "device 'Left' cannot be opened: HD_DEVICE_FAULT" in tool.fault, LEFT)
    rig.until_felt(RIGHT)

    rig.hook("unplug 1 0")
    rig.hook(f"init_ms {NOT_YET_MS}")
    assert without_force(bench.hear(300), LEFT), "not by itself"
    rig.arm_the_rig()
    bench.until(lambda tool: "the arm 'Left' is being opened anew" in tool.fault, LEFT)
    bench.until(lambda tool: "let go while another arm is being opened anew" in tool.fault, RIGHT)
    rig.hook("init_ms 0")
    for which in (LEFT, RIGHT):
        rig.until_felt(which)
        bench.until(lambda tool: tool.fault == "", which)
    assert rig.gateway.poll() is None
    assert_goes_on(bench.frames[gone:], RIGHT)
    no_step_above_the_rate_limit(bench.frames[gone:], LEFT)
    no_step_above_the_rate_limit(bench.frames, RIGHT)
    rig.gateway.terminate()
    assert rig.gateway.wait(PATIENCE_S) == 0


def assert_goes_on(frames: list[Any], which: int) -> None:
    """Nothing lets a hand go, but a machine that keeps its models for longer than they live."""
    tools = [frame.body.instruments[which] for frame in frames]
    assert tools[-1].state == "active"
    left = [after for before, after in itertools.pairwise(tools) if before.state == "active" != after.state]
    assert all(tool.state == "stale" and tool.model_age_s >= TTL_S for tool in left)


def without_force(frames: list[Any], which: int) -> bool:
    return bool(frames) and not forces(frames, which).any()


def no_step_above_the_rate_limit(frames: list[Any], which: int) -> None:
    """Of what the library's thread applied, as the gateway saw it: that may be a step more since the last look."""
    neighbours = np.diff([frame.body.tick for frame in frames]) == 1
    passed_s = np.diff([frame.origin_ns for frame in frames]) * 1e-9
    steps = np.linalg.norm(np.diff(forces(frames, which), axis=0), axis=1)
    assert neighbours.sum() > 500
    assert (steps[neighbours] <= RATE_LIMIT_N_S * (np.minimum(passed_s, 0.02) + 2e-3)[neighbours]).all()
