"""A rig in memory: haptics and physics on one hub, with a hand that the test moves."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import pytest

from tests.memory_bus import MemoryBus, MemoryHub
from tests.memory_process import MemoryProcess
from trocar.protocol import TOPICS
from trocar.protocol.bodies import GatewayState, InstrumentState, LocalModel
from trocar.services.files.cache_directory import cache_directory
from trocar.services.haptics import __main__ as haptics
from trocar.services.haptics.__main__ import Haptics
from trocar.services.physics import __main__ as physics
from trocar.services.physics.__main__ import Physics
from trocar.services.runtime.loop.loop import LoopMeter, TickClock
from trocar.services.scenes import load_duct, load_scene

SMALL = Path(__file__).parents[1] / "scenes" / "small.yaml"
STALE_S = 60.0
PORTS = ((0.06, -0.10, 0.13), (0.08, 0.10, 0.13))


class Rig:
    """Gateway by hand, haptics and physics for real, on a bus in memory; `overrides` of the scene as ``--set`` has."""

    def __init__(self, *overrides: str) -> None:
        self.hub = MemoryHub()
        self.gateway = MemoryBus(self.hub, publishes=["gateway.state"], reads=["haptics.contact_model"])
        self.haptics_process, self.physics_process = (
            MemoryProcess("haptics", self.hub),
            MemoryProcess("physics", self.hub),
        )
        scene = load_scene(SMALL, overrides)
        duct = load_duct(scene, cache_directory(), lambda stage, fraction: None)
        self.haptics_meter = LoopMeter(1000.0, haptics.STAGES)
        self.haptics = Haptics(self.haptics_process, self.haptics_meter, scene, duct)  # type: ignore[arg-type]
        self.meter = LoopMeter(1000.0, physics.STAGES)
        self.clock = TickClock(self.meter)
        self.physics = Physics(self.physics_process, self.meter, scene, duct)  # type: ignore[arg-type]
        self.tick = self.begins = 0

    def turn(self, *hips_m: tuple[float, float, float], handle_rad: float = 0.5, roll_rad: float = 0.0) -> None:
        """One millisecond: device frame, haptics, physics."""
        instruments = tuple(
            InstrumentState(
                name=f"{i}", position_m=hip, port_m=PORTS[i % 2], handle_angle_rad=handle_rad, roll_rad=roll_rad
            )
            for i, hip in enumerate(hips_m)
        )
        state = GatewayState(tick=self.tick, instruments=instruments, begins=self.begins)
        self.gateway.publish("gateway.state", state, origin_ns=time.monotonic_ns())
        self.tick += 1
        frame = self.haptics_process.bus.latest("gateway.state")
        assert frame is not None
        self.haptics.answer(frame)
        contacts = self.physics_process.bus.latest("haptics.contacts")
        if contacts is None:  # as on a rung on which a step is several ticks
            assert self.haptics.ticks_per_step > 1, self.physics_process.bus.reports()
            return
        self.physics.advance(contacts, self.clock.steps(contacts.body.tick))

    def models(self) -> tuple[LocalModel, ...]:
        """Return the newest contact model of every instrument."""
        frame = self.gateway.latest("haptics.contact_model")
        assert frame is not None
        models: tuple[LocalModel, ...] = frame.body.local_models()
        return models

    def model(self) -> LocalModel:
        """Return the newest contact model of the first instrument."""
        return self.models()[0]


def let_time_pass(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let turns be made faster or slower than a rig's."""
    # The flood limit is tested elsewhere.
    monkeypatch.setattr("trocar.services.runtime.bus.bus.FLOOD_FACTOR", 1e6)
    # A turn may take longer than a tick on a busy machine: what is old is decided by the test.
    monkeypatch.setitem(TOPICS, "physics.state", replace(TOPICS["physics.state"], stale_after_s=STALE_S))


@pytest.fixture
def in_memory(monkeypatch: pytest.MonkeyPatch) -> type[Rig]:
    """Return `Rig` in a world where turns may be made faster or slower than a rig's."""
    let_time_pass(monkeypatch)
    return Rig


@pytest.fixture
def rig(in_memory: type[Rig]) -> Rig:
    return in_memory()
