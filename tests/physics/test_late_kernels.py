"""No kernel is compiled, or read from disk, once a loop runs: in any scene, while its own hands play.

Haptics and physics answer each other each in a process of its own, in which nobody else compiles anything for it: forks
of one that has imported what a rig imports, and has compiled nothing.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Iterator, Sequence
from multiprocessing import Pipe, get_context
from multiprocessing.connection import Connection
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tests.kernels.preloaded import Preloaded
from tests.kernels.signatures import compiled_signatures
from tests.memory_bus import MemoryBus, MemoryHub
from tests.memory_process import MemoryProcess
from tests.physics.conftest import let_time_pass
from trocar.protocol.bodies import GatewayState, InstrumentState
from trocar.services.files.cache_directory import cache_directory
from trocar.services.haptics import __main__ as haptics_process
from trocar.services.haptics.__main__ import Haptics
from trocar.services.mechanics.scene import SceneModel
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation.scene_catheter import place_catheter
from trocar.services.physics import __main__ as physics_process
from trocar.services.physics.__main__ import Physics
from trocar.services.physics.duct_alone_loop import STAGES as DUCT_STAGES
from trocar.services.physics.duct_alone_loop import DuctAlonePhysics
from trocar.services.runtime.config.config import config_directory
from trocar.services.runtime.loop.loop import LoopMeter, Tick, TickClock
from trocar.services.scenes import load_scene
from trocar.services.scenes.hands import hands_of, out_of_the_way
from trocar.services.scenes.ready import load_surface

#: Of the hands' motion; then they begin again. A rung of the ladder holds for so many ticks.
TICKS, AGAIN, RUNG = 600, 200, 100
#: Smaller ducts: what is compiled does not depend on their size.
SMALL = ["duct.n_around=12", "duct.n_along=16", "duct.n_modes=24"]
BY_DAY = ("everything", "guide-wire", "duct-only")
NEEDS = {"anatomy": "a surface that is not in the repository"}
SCENES = sorted(path.stem for path in (config_directory() / "scenes").glob("*.yaml") if path.stem not in NEEDS)
ROOT = Path(__file__).parents[2]
Said = list[tuple[str, bytes]]
Work = Callable[[str, Connection], set[str]]


PLAY = "import sys; from tests.physics import test_late_kernels as test; test.play(sys.argv[1])"


@pytest.fixture(scope="module")
def preloaded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Preloaded]:
    with Preloaded(tmp_path_factory.mktemp("rig"), "import tests.physics.test_late_kernels") as made:
        yield made


@pytest.mark.timeout(900)  # on a machine that has compiled nothing yet
@pytest.mark.parametrize("scene", [pytest.param(s, marks=() if s in BY_DAY else pytest.mark.long) for s in SCENES])
def test_nothing_is_compiled_while_a_scenes_hands_play(scene: str, preloaded: Preloaded) -> None:
    run = preloaded.start(PLAY, [scene], ROOT, os.environ).wait()
    assert run.returncode == 0, run.stderr
    loops = ("physics",) if load_scene(scene, []).duct_alone else ("haptics", "physics")
    assert json.loads(run.stdout.splitlines()[-1]) == {name: [] for name in loops}


def _config(scene: str) -> Any:
    return SimpleNamespace(scene_name=scene, scene_overrides=SMALL)


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


class _Hub(MemoryHub):
    """Where a process meets the others, which are at the other end of a link."""

    def __init__(self) -> None:
        super().__init__()
        self.said: Said = []

    def send(self, name: str, data: bytes) -> None:
        super().send(name, data)
        self.said.append((name, data))

    def ticks(self, link: Connection) -> Iterator[None]:
        """Yield at each tick, with what the others have said; what is said here until the next one is told them."""
        while (heard := link.recv()) is not None:
            for name, data in heard:
                super().send(name, data)
            self.said = []
            yield
            link.send(self.said)


def _haptics(scene: str, link: Connection) -> set[str]:
    """Answer devices; return what haptics compiles once it runs."""
    model, duct = haptics_process.prepare(_config(scene))
    process = MemoryProcess("haptics", hub := _Hub())
    haptics = Haptics(process, LoopMeter(1000.0), model, duct)  # type: ignore[arg-type]
    before = compiled_signatures()
    for _ in hub.ticks(link):
        frame = process.bus.latest("gateway.state")
        assert frame is not None
        haptics.answer(frame)
        haptics.do_side_work()
    return compiled_signatures() - before


def _physics(scene: str, link: Connection) -> set[str]:
    """Answer contacts on all rungs in turn; return what physics compiles once it runs."""
    model, duct = physics_process.prepare(_config(scene))
    process, meter = MemoryProcess("physics", hub := _Hub()), LoopMeter(1000.0, physics_process.STAGES)
    physics, clock = Physics(process, meter, model, duct), TickClock(meter)  # type: ignore[arg-type]
    before = compiled_signatures()
    for _ in hub.ticks(link):
        frame = process.bus.latest("haptics.contacts")
        if frame is not None:  # on a rung of longer steps haptics speaks more seldom
            physics.obey(frame.body.tick // RUNG % len(model.quality))
            physics.advance(frame, clock.steps(frame.body.tick))
            physics.do_side_work()
    assert meter.tick > TICKS, "it heard all that was said"
    return compiled_signatures() - before


def _run(work: Work, scene: str, link: Connection, not_ours: Sequence[Connection]) -> None:
    """Run a process of the rig, which ends with whoever started it: nobody else holds the other end of its link."""
    for each in not_ours:
        each.close()
    link.send(sorted(work(scene, link)))


def _play_rig(scene: str) -> dict[str, list[str]]:
    """Let haptics and physics answer the scene's hands, which begin again; return what each compiles meanwhile."""
    pairs = [Pipe(), Pipe()]
    (haptics, _), (physics, _) = pairs
    for work, (_, link) in zip((_haptics, _physics), pairs, strict=True):
        others = [end for pair in pairs for end in pair if end is not link]
        get_context("fork").Process(target=_run, args=(work, scene, link, others), daemon=True).start()
    for _, link in pairs:
        link.close()
    config = _config(scene)
    hub, hands, answer = _Hub(), _Hands(load_scene(config.scene_name, config.scene_overrides)), Said()
    gateway = MemoryBus(hub, publishes=["gateway.state"])
    for tick in range(TICKS + AGAIN):
        state = GatewayState(tick=tick, instruments=hands.at(tick % TICKS), begins=tick // TICKS)
        gateway.publish("gateway.state", state, origin_ns=time.monotonic_ns())
        answer = _ask(physics, _ask(haptics, [*answer, *hub.said]))
        hub.said = []
    return {"haptics": _ask(haptics, None), "physics": _ask(physics, None)}


def _ask(link: Connection, said: Said | None) -> Any:
    link.send(said)
    return link.recv()


def _step_alone(scene: str) -> dict[str, list[str]]:
    """Return what physics compiles once a duct runs that is alone."""
    model, duct = physics_process.prepare(_config(scene))
    process = MemoryProcess("physics", MemoryHub())
    physics = DuctAlonePhysics(process, LoopMeter(1000.0, DUCT_STAGES), model, duct)  # type: ignore[arg-type]
    before = compiled_signatures()
    for tick in range(TICKS):
        physics.advance(Tick(tick, 0, time.monotonic_ns()))
    return {"physics": sorted(compiled_signatures() - before)}


def play(scene: str) -> None:
    """Print what is compiled, by process, while a scene runs: nothing has been compiled in this process before."""
    assert not compiled_signatures()
    let_time_pass(pytest.MonkeyPatch())
    print(json.dumps((_step_alone if load_scene(scene, []).duct_alone else _play_rig)(scene)))
