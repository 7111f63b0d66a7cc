"""The frames of a rig in memory whose simulated hands do a scenario: haptics and physics are the real ones."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace

import msgspec
import pytest

from tests.memory_bus import MemoryBus, MemoryHub
from tests.memory_process import MemoryProcess
from trocar.protocol import TOPICS
from trocar.protocol.bodies import GatewayState, InstrumentState
from trocar.protocol.bodies.training import Attempt
from trocar.services.files.cache_directory import cache_directory
from trocar.services.haptics import __main__ as haptics
from trocar.services.mechanics.scenarios import PlayedScene
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.physics import __main__ as physics
from trocar.services.runtime.loop.loop import LoopMeter, TickClock
from trocar.services.scenes import load_duct
from trocar.services.scenes.duct_file import duct_file
from trocar.services.training.site import Site, read_site

FAST = ("gateway.state", "haptics.contacts", "physics.state")


class SimulatedRig:
    """Hands, haptics and physics of a scenario, tick by tick; `pace` is of the hands."""

    def __init__(self, scenario: PlayedScene, pace: float = 1.0) -> None:
        hub = MemoryHub()
        self._gateway = MemoryBus(hub, publishes=["gateway.state"])
        self._observer = MemoryBus(hub, reads_every=FAST)
        self._haptics_process, self._physics_process = MemoryProcess("haptics", hub), MemoryProcess("physics", hub)
        duct = load_duct(scenario.scene, cache_directory(), lambda stage, fraction: None)
        self._haptics = haptics.Haptics(
            self._haptics_process, LoopMeter(1000.0, haptics.STAGES), scenario.scene, duct  # type: ignore[arg-type]
        )  # fmt: skip
        meter = LoopMeter(1000.0, physics.STAGES)
        self._clock = TickClock(meter)
        self._physics = physics.Physics(self._physics_process, meter, scenario.scene, duct)  # type: ignore[arg-type]
        self._scenario, self._pace = scenario, pace
        self._inputs = ToolInputs()
        self.site: Site = read_site(duct_file(duct, scenario.scene))

    def messages(self, seconds: float) -> Iterator[tuple[str, int, msgspec.Struct]]:
        """Yield topic, time in ns and body of every frame of the fast topics."""
        for tick in range(round(1000 * seconds)):
            self._gateway.publish("gateway.state", self._hands(tick), origin_ns=time.monotonic_ns())
            frame = self._haptics_process.bus.latest("gateway.state")
            assert frame is not None
            self._haptics.answer(frame)
            contacts = self._physics_process.bus.latest("haptics.contacts")
            assert contacts is not None
            self._physics.advance(contacts, self._clock.steps(contacts.body.tick))
            self._physics.do_side_work()
            for topic in FAST:
                for frame in self._observer.drain(topic):
                    yield topic, tick * 1_000_000, frame.body

    def _hands(self, tick: int) -> GatewayState:
        scene, inputs = self._scenario.scene, self._inputs
        self._scenario.write_inputs(min(tick * 1e-3 * self._pace, self._scenario.duration_s), inputs)
        return GatewayState(
            tick=tick,
            instruments=tuple(
                InstrumentState(
                    name=name,
                    position_m=tuple(inputs.position_m[k].tolist()),
                    port_m=forceps.port_position_m,
                    handle_angle_rad=float(inputs.jaw_angle_rad[k]) / forceps.handle_range[0],
                    roll_rad=float(inputs.roll_rad[k]),
                )
                for k, (name, forceps) in enumerate(zip(("right", "left"), scene.forceps, strict=False))
            ),
        )


@pytest.fixture
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Be patient in a test."""
    be_patient(monkeypatch)


def be_patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let frames of memory be as old as a busy machine makes them."""
    monkeypatch.setattr("trocar.services.runtime.bus.bus.FLOOD_FACTOR", 1e6)
    for name in FAST:
        monkeypatch.setitem(TOPICS, name, replace(TOPICS[name], stale_after_s=60.0))


def attempt(state: str = "running", **said: object) -> Attempt:
    """Return the word of an attempt."""
    return msgspec.structs.replace(Attempt(begins=0, attempt_id="a", state=state, scenario="made-up"), **said)
