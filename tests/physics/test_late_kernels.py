"""No kernel is compiled, or read from disk, once a loop runs: in any scene, while its own hands play.

What haptics and physics say to each other is recorded once; then each hears it in a process of its own, in which nobody
else compiles anything for it.
"""

from __future__ import annotations

import json
import pickle
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from protocol import decode
from protocol.bodies import GatewayState, InstrumentState
from services.cache_directory import cache_directory
from services.haptics import __main__ as haptics_process
from services.haptics.__main__ import Haptics
from services.mechanics.compiled import KERNELS
from services.mechanics.reduction.reduced_duct import ReducedDuct
from services.mechanics.scene import SceneModel
from services.mechanics.scene.tools import ToolInputs
from services.mechanics.simulation.scene_catheter import place_catheter
from services.physics import __main__ as physics_process
from services.physics.__main__ import Physics
from services.physics.duct_alone_loop import STAGES as DUCT_STAGES
from services.physics.duct_alone_loop import DuctAlonePhysics
from services.runtime.config import config_directory
from services.runtime.loop import LoopMeter, Tick, TickClock
from services.scenes import load_scene
from services.scenes.hands import hands_of, out_of_the_way
from services.scenes.ready import load_surface
from tests.memory_bus import MemoryBus, MemoryHub
from tests.memory_process import MemoryProcess
from tests.physics.conftest import let_time_pass

#: Of the hands' motion; then they begin again. A rung of the ladder holds for so many ticks.
TICKS, AGAIN, RUNG = 1200, 200, 100
#: Smaller ducts: what is compiled does not depend on their size.
SMALL = ["duct.n_around=12", "duct.n_along=16", "duct.n_modes=24"]
BY_DAY = ("everything", "guide-wire", "duct-only")
NEEDS = {"anatomy": "a surface that is not in the repository"}
SCENES = sorted(path.stem for path in (config_directory() / "scenes").glob("*.yaml") if path.stem not in NEEDS)
Said = list[tuple[str, bytes]]


@pytest.mark.timeout(900)  # on a machine that has compiled nothing yet
@pytest.mark.parametrize("scene", [pytest.param(s, marks=() if s in BY_DAY else pytest.mark.long) for s in SCENES])
def test_nothing_is_compiled_while_a_scenes_hands_play(scene: str, tmp_path: Path) -> None:
    said = tmp_path / "said"
    for what in ("duct",) if load_scene(scene, []).duct_alone else ("record", "physics", "haptics"):
        command = [sys.executable, "-m", "tests.physics.test_late_kernels", what, scene, str(said)]
        run = subprocess.run(command, cwd=Path(__file__).parents[2], capture_output=True, text=True, check=False)
        assert run.returncode == 0, run.stderr
        assert json.loads(run.stdout.splitlines()[-1]) == [], what


class _Recorded(MemoryHub):
    """Keeps what was said."""

    def __init__(self) -> None:
        super().__init__()
        self.said: Said = []

    def send(self, name: str, data: bytes) -> None:
        super().send(name, data)
        self.said.append((name, data))


def _signatures() -> set[str]:
    return {f"{each.py_func.__qualname__} {types}" for each in KERNELS for types in each.signatures}


def _config(scene: str) -> Any:
    return SimpleNamespace(scene_name=scene, scene_overrides=() if scene == "duct-only" else SMALL)


class _Hands:
    """The gateway's instruments at each tick: a tool that has nothing to do waits near its port."""

    def __init__(self, scene: SceneModel) -> None:
        mesh = load_surface(scene, cache_directory())
        self._scene = scene
        self._hands, self._tools = hands_of(place_catheter(scene, mesh), mesh), ToolInputs()
        self._waits = [out_of_the_way(scene, k, mesh).grip_point_m[0] for k in range(len(scene.forceps))]

    def at(self, tick: int) -> tuple[InstrumentState, ...]:
        self._hands.write_inputs(self._hands.duration_s * tick / TICKS, self._tools)
        return tuple(self._instrument(k) for k in range(len(self._scene.forceps)))

    def _instrument(self, k: int) -> InstrumentState:
        tools, kind = self._tools, self._scene.forceps[k]
        ratio = kind.jaws.jaw_ratio if kind.jaws is not None else 1.0
        return InstrumentState(
            name=f"{k}",
            position_m=tuple(tools.position_m[k].tolist()) if tools.present[k] else self._waits[k],
            port_m=kind.port_position_m,
            roll_rad=float(tools.roll_rad[k]),
            handle_angle_rad=float(tools.jaw_angle_rad[k]) / ratio,
        )


def _play(scene: str, said: Path) -> set[str]:
    """Let haptics and physics answer the scene's hands, which begin again, on all rungs in turn; keep what they say."""
    model, duct = physics_process.prepare(_config(scene))
    hub, hands = _Recorded(), _Hands(model)
    gateway = MemoryBus(hub, publishes=["gateway.state"])
    haptics = Haptics(MemoryProcess("haptics", hub), LoopMeter(1000.0), model, duct)  # type: ignore[arg-type]
    physics, clock, heard = _physics(hub, model, duct)
    for tick in range(TICKS + AGAIN):
        state = GatewayState(tick=tick, instruments=hands.at(tick % TICKS), begins=tick // TICKS)
        gateway.publish("gateway.state", state, origin_ns=time.monotonic_ns())
        frame = haptics._bus.latest("gateway.state")
        assert frame is not None
        haptics.answer(frame)
        _advance(physics, clock, heard, len(model.quality))
    said.write_bytes(pickle.dumps(hub.said))
    return set()


def _physics(hub: MemoryHub, scene: SceneModel, duct: ReducedDuct) -> tuple[Physics, TickClock, MemoryBus]:
    process, meter = MemoryProcess("physics", hub), LoopMeter(1000.0, physics_process.STAGES)
    physics = Physics(process, meter, scene, duct)  # type: ignore[arg-type]
    return physics, TickClock(meter), process.bus


def _advance(physics: Physics, clock: TickClock, heard: MemoryBus, rungs: int) -> None:
    """Answer what haptics has said, if it has: on a rung of longer steps it speaks more seldom."""
    frame = heard.latest("haptics.contacts")
    if frame is not None:
        physics.obey(frame.body.tick // RUNG % rungs)
        physics.advance(frame, clock.steps(frame.body.tick))
        physics.settle()


def _answer_contacts(scene: str, said: Path) -> set[str]:
    """Return what physics compiles once it runs."""
    model, duct = physics_process.prepare(_config(scene))
    hub = MemoryHub()
    others, (physics, clock, heard) = MemoryBus(hub, publishes=["haptics.contacts"]), _physics(hub, model, duct)
    before = _signatures()
    for name, data in pickle.loads(said.read_bytes()):
        if name == "haptics.contacts":
            others.publish(name, decode(data).body)
            _advance(physics, clock, heard, len(model.quality))
    assert physics._meter.tick > TICKS, "it heard what was recorded"
    return _signatures() - before


def _answer_devices(scene: str, said: Path) -> set[str]:
    """Return what haptics compiles once it runs."""
    model, duct = haptics_process.prepare(_config(scene))
    hub = MemoryHub()
    others, process = MemoryBus(hub, publishes=["gateway.state", "physics.state"]), MemoryProcess("haptics", hub)
    haptics = Haptics(process, LoopMeter(1000.0), model, duct)  # type: ignore[arg-type]
    before = _signatures()
    for name, data in pickle.loads(said.read_bytes()):
        if name in ("gateway.state", "physics.state"):
            others.publish(name, decode(data).body)
            frame = process.bus.latest("gateway.state")
            if frame is not None:
                haptics.answer(frame)
                haptics.settle()
    return _signatures() - before


def _step_alone(scene: str, _said: Path) -> set[str]:
    """Return what physics compiles once a duct runs that is alone."""
    model, duct = physics_process.prepare(_config(scene))
    process = MemoryProcess("physics", MemoryHub())
    physics = DuctAlonePhysics(process, LoopMeter(1000.0, DUCT_STAGES), model, duct)  # type: ignore[arg-type]
    before = _signatures()
    for tick in range(TICKS):
        physics.advance(Tick(tick, 0, time.monotonic_ns()))
    return _signatures() - before


if __name__ == "__main__":
    let_time_pass(pytest.MonkeyPatch())
    parts = {"record": _play, "physics": _answer_contacts, "haptics": _answer_devices, "duct": _step_alone}
    print(json.dumps(sorted(parts[sys.argv[1]](sys.argv[2], Path(sys.argv[3])))))
