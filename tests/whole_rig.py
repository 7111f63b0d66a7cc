"""Gateway, haptics and physics as they are, with simulated arms, in process and in time that passes tick by tick."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
import yaml

import trocar.services.gateway.__main__ as gateway_process
from tests.memory_bus import MemoryBus, MemoryHub
from tests.memory_process import MemoryProcess, in_time_of
from trocar.protocol.bodies import GatewayState, PhysicsState
from trocar.services.files.cache_directory import cache_directory
from trocar.services.gateway.devices.driver import GraspHandle
from trocar.services.gateway.drivers.phantom_simulated import Driver as SimulatedArm
from trocar.services.gateway.motions.scene_hands import SceneHands
from trocar.services.gateway.motions.script import HANDLE
from trocar.services.gateway.servo.servo_arrays import HANDLE_ANGLE, HANDLE_RATE
from trocar.services.haptics import __main__ as haptics_process
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.reduction.reduced_duct import ReducedDuct
from trocar.services.mechanics.scene import SceneModel
from trocar.services.mechanics.simulation.scene_duct import build_scene_duct
from trocar.services.physics import __main__ as physics_process
from trocar.services.runtime.config import config
from trocar.services.runtime.loop.loop import LoopMeter, Tick, TickClock

TICK_NS = 1_000_000
RATE_N_S, LIMIT_N = 200.0, 3.0


class ScriptedHandle(GraspHandle):
    """The handle of an arm's own script, held so firmly that no torque moves it."""

    max_torque_nm = 0.3

    def __init__(self, arm: SimulatedArm) -> None:
        self._arm = arm
        self.torque_nm = 0.0

    def open(self) -> None:
        pass

    def enable(self) -> None:
        self.ready = True

    def read(self, time_ns: int, handle: FloatArray) -> None:
        player = self._arm._player
        handle[HANDLE_ANGLE] = 1.0 if player is None else player.value[HANDLE]
        handle[HANDLE_RATE] = 0.0 if player is None else player.rate[HANDLE]

    def write(self, torque_nm: float) -> None:
        self.torque_nm = torque_nm

    def close(self) -> None:
        pass


@dataclass(frozen=True)
class Moment:
    """What gateway and physics said of one tick, and what each servo has in its books."""

    devices: GatewayState
    solved: PhysicsState
    energy_j: tuple[float, ...]


class WholeRig:
    """Two simulated arms in a scene; `arms` are the settings of their drivers, `hands` what a script "scene" means."""

    def __init__(
        self,
        folder: Path,
        monkeypatch: pytest.MonkeyPatch,
        scene: SceneModel,
        arms: tuple[dict[str, Any], ...],
        hands: SceneHands | None = None,
    ) -> None:
        self.now_ns = 10**12
        in_time_of(monkeypatch, lambda: self.now_ns, self._sleep_until)
        hub = MemoryHub()
        rig = config.load_rig(rig_file(folder, scene, arms))
        self.scene = scene
        self.duct: ReducedDuct = build_scene_duct(scene, cache_directory() / "bases")
        gateway, haptics, physics = (MemoryProcess(name, hub, rig) for name in ("gateway", "haptics", "physics"))
        self.gateway = gateway_process.Gateway(cast(Any, gateway), hands or SceneHands())
        haptics_meter = LoopMeter(1000.0, haptics_process.STAGES)
        self.haptics = haptics_process.Haptics(cast(Any, haptics), haptics_meter, scene, self.duct)
        physics_meter = LoopMeter(1000.0, physics_process.STAGES)
        self.physics = physics_process.Physics(cast(Any, physics), physics_meter, scene, self.duct)
        self._haptics_bus, self._physics_bus = haptics.bus, physics.bus
        self._clock = TickClock(physics_meter)
        self._listener = MemoryBus(hub, reads=["gateway.state", "physics.state"])
        self.tools = self.gateway.instruments
        for tool, kind in zip(self.tools, scene.forceps, strict=True):
            tool.grasp = ScriptedHandle(cast(SimulatedArm, tool.arm)) if kind.has_handle else None
        self.gateway.open()
        self.moments: list[Moment] = []
        self._index = 0
        self._start_ns = self.now_ns

    def _sleep_until(self, deadline_ns: int) -> None:
        self.now_ns = max(self.now_ns, deadline_ns)

    def run(self, seconds: float) -> list[Moment]:
        """Tick for `seconds` and return these moments."""
        first = len(self.moments)
        for _ in range(round(seconds * 1e3)):
            self._tick()
        return self.moments[first:]

    def _tick(self) -> None:
        due_ns = self._start_ns + self._index * TICK_NS
        self._sleep_until(due_ns)
        self.gateway.tick(Tick(self._index, due_ns, self.now_ns))
        self._index += 1
        devices = self._haptics_bus.latest("gateway.state")
        assert devices is not None
        self.haptics.answer(devices)
        contacts = self._physics_bus.latest("haptics.contacts")
        assert contacts is not None
        self.physics.advance(contacts, self._clock.steps(contacts.body.tick))
        self.physics.do_side_work()
        self.gateway.serve(due_ns + TICK_NS)
        said, solved = (self._listener.latest(name) for name in ("gateway.state", "physics.state"))
        assert said is not None
        assert solved is not None
        self.moments.append(Moment(said.body, solved.body, tuple(tool.servo.energy_j for tool in self.tools)))

    def forces_n(self) -> FloatArray:
        """Return what the arms applied, (ticks, tools, 3)."""
        return np.array([[tool.applied_force_n for tool in moment.devices.instruments] for moment in self.moments])


def rig_file(folder: Path, scene: SceneModel, arms: tuple[dict[str, Any], ...], **gateway: Any) -> Path:
    """Write a rig file of two simulated arms with these settings of their drivers; `gateway` changes what it says.

    Their friction was measured, as it were: all of it is relied on. So forces of tissue below it, which a pinch puts
    on a hand that stands still, are not bounded, and what an arm applies can be compared with what was solved.
    """
    arm = config.read_yaml(config.find("device", "phantom_premium_1_5"))
    measured = folder / "measured.yaml"
    measured.write_text(yaml.safe_dump({**arm, "sure_friction": 1.0}))
    mounts = (
        {"centre_m": [0.065, -0.005, 0.020], "yaw_rad": 1.5708},
        {"centre_m": [0.028, 0.010, 0.025], "yaw_rad": -1.5708},
    )
    rows = [
        {
            "name": name, "port_m": list(forceps.port_position_m), "mount": mount,
            "arm": {"driver": "phantom_simulated", "device": str(measured), "settings": settings},
        }
        for name, forceps, mount, settings in zip(("left", "right"), scene.forceps, mounts, arms, strict=True)
    ]  # fmt: skip
    settings = {
        "instruments": rows, "engage_ramp_s": 0.1, "supervisor_timeout_s": None, "force_limit_n": LIMIT_N,
        "force_rate_limit_n_s": RATE_N_S, "grasp_torque_limit_nm": 0.3, **gateway,
    }  # fmt: skip
    file = folder / "rig.yaml"
    file.write_text(yaml.safe_dump({"name": "whole", "gateway": settings}))
    return file
