"""A gateway as it is, in process and in time that a test lets pass: a simulated arm at a wall, a drive on a CAN bus."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, cast

import pytest
import yaml

import trocar.services.gateway.__main__ as gateway_process
from tests.gateway.can.virtual_node import VirtualNode
from tests.memory_bus import MemoryBus, MemoryHub
from tests.memory_process import MemoryProcess, in_time_of
from trocar.protocol import topic
from trocar.protocol.bodies import ContactModel, InstrumentState, LocalModel
from trocar.services.gateway.drivers.grasp_odrive_can import OdriveGrasp
from trocar.services.gateway.drivers.phantom_simulated import Driver as SimulatedArm
from trocar.services.gateway.instruments import instrument
from trocar.services.gateway.motions.scene_hands import SceneHands
from trocar.services.runtime.bus import bus
from trocar.services.runtime.config import config
from trocar.services.runtime.loop.loop import Tick
from trocar.studies.feel.hands import Books

TICK_NS = 1_000_000
TTL_S, RATE_N_S, TORQUE_NM, LIMIT_N = 0.02, 200.0, 0.3, 3.0
#: The wall is met at a height; the thing between the jaws at an opening.
WALL_M, WALL_N_M, WALL_N_S_M = 0.020, 400.0, 1.0
MET_RAD, GRASP_NM_RAD, GRASP_NM_S_RAD = 0.6, 0.4, 2e-4
#: Downward into the wall, to and fro in it, and away; begins with the force, after about 0.1 s.
PRESSED_S, LEAVES_S, ENDS_S = 0.4, 1.4, 2.0

Message = tuple[int, bytes]  # in how many ticks it comes, and what
Stream = Callable[["Haptics", ContactModel, int], list[Message]]


class RigClock:
    """Time that passes only while somebody sleeps; a drive lives in its milliseconds, unless it is dead."""

    def __init__(self, node: VirtualNode) -> None:
        self.now_ns = 10**12
        self.node_lives = True
        self._node = node

    def monotonic_ns(self) -> int:
        return self.now_ns

    def sleep(self, seconds: float) -> None:
        self.sleep_until(self.now_ns + round(seconds * 1e9))

    def sleep_until(self, deadline_ns: int) -> None:
        while (next_ns := (self.now_ns // TICK_NS + 1) * TICK_NS) <= deadline_ns:
            self.now_ns = next_ns
            if self.node_lives:
                self._node.advance()
        self.now_ns = max(self.now_ns, deadline_ns)


class Haptics:
    """ModelIntake every device frame for a wall and a thing between the jaws, as `local_model` would."""

    def __init__(self, hub: MemoryHub) -> None:
        self.hub = hub
        self.bus = MemoryBus(hub, reads=["gateway.state"])
        self.restart()

    def restart(self) -> None:
        self._outbox = bus.Outbox(topic("haptics.contact_model"), bus.new_incarnation())

    def seal(self, body: ContactModel, origin_ns: int, valid: bool = True) -> bytes:
        return self._outbox.seal(body, origin_ns, valid)

    def answer(self) -> tuple[ContactModel, int]:
        frame = self.bus.latest("gateway.state")
        assert frame is not None
        models = tuple(map(model_of, frame.body.instruments))
        return ContactModel.of(frame.body.tick, TTL_S, models), frame.origin_ns


def model_of(state: InstrumentState) -> LocalModel:
    depth_m, squeezed_rad = max(0.0, WALL_M - state.position_m[2]), max(0.0, MET_RAD - state.handle_angle_rad)
    inside, squeezes = depth_m > 0.0, squeezed_rad > 0.0
    return LocalModel(
        force_n=(0.0, 0.0, WALL_N_M * depth_m),
        stiffness_n_m=(0.0,) * 8 + (WALL_N_M * inside,),
        damping_n_s_m=(0.0,) * 8 + (WALL_N_S_M * inside,),
        reference_position_m=state.position_m,
        reference_velocity_m_s=state.velocity_m_s,
        grasp_torque_nm=GRASP_NM_RAD * squeezed_rad,
        grasp_stiffness_nm_rad=GRASP_NM_RAD * squeezes,
        grasp_damping_nm_s_rad=GRASP_NM_S_RAD * squeezes,
        reference_angle_rad=state.handle_angle_rad,
        in_contact=inside or squeezes,
    )


@dataclass(frozen=True)
class Moment:
    """One tick: what was said of the instrument, what the drive applied, and when."""

    now_ns: int
    state: InstrumentState
    applied_nm: float


class Drill:
    """A gateway with one instrument, tick by tick."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.node = VirtualNode(str(folder))
        self.clock = RigClock(self.node)
        in_time_of(monkeypatch, self.clock.monotonic_ns, self.clock.sleep_until)
        monkeypatch.setattr(instrument, "Place", partial(instrument.Place, clock=self.clock))
        hub = MemoryHub()
        process = MemoryProcess("gateway", hub, config.load_rig(_rig_file(folder)))
        self.gateway = gateway_process.Gateway(cast(Any, process), SceneHands())
        self.haptics = Haptics(hub)
        self.gateway.open()
        (self.tool,) = self.gateway.instruments
        self.arm, self.grasp = cast(SimulatedArm, self.tool.arm), cast(OdriveGrasp, self.tool.grasp)
        self.books = Books()
        self.moments: list[Moment] = []
        self._coming: list[Message] = []
        self._start_ns = self.clock.now_ns
        self._index = 0

    def run(self, seconds: float, stream: Stream | None = None) -> list[Moment]:
        """Tick for `seconds`; models come as `stream` says, by default at once. Return these moments."""
        first = len(self.moments)
        for _ in range(round(seconds * 1e3)):
            self._tick(stream or at_once)
        return self.moments[first:]

    def stall(self, seconds: float) -> None:
        """Hold the gateway up: time passes without a tick of it."""
        self.clock.sleep(seconds)
        self._index = (self.clock.now_ns - self._start_ns) // TICK_NS

    def _tick(self, stream: Stream) -> None:
        due_ns = self._start_ns + self._index * TICK_NS
        self.clock.sleep_until(due_ns)
        tick = Tick(self._index, due_ns, self.clock.now_ns)
        self.books.step(self.arm.arm, partial(self.gateway.tick, tick))
        body, origin_ns = self.haptics.answer()
        self._coming += stream(self.haptics, body, origin_ns)
        for wait, data in self._coming:
            if wait == 0:
                self.haptics.hub.send("haptics.contact_model", data)
        self._coming = [(wait - 1, data) for wait, data in self._coming if wait]
        self.gateway.serve(due_ns + TICK_NS)
        self.moments.append(Moment(tick.started_ns, self.tool.state(), self.node.drive.applied_nm))
        self._index += 1

    def close(self) -> None:
        self.gateway.close()
        self.node.close()


def at_once(haptics: Haptics, body: ContactModel, origin_ns: int) -> list[Message]:
    return [(0, haptics.seal(body, origin_ns))]


def _rig_file(folder: Path) -> Path:
    script = folder / "press.yaml"
    heights = [(0.0, 0.028), (PRESSED_S, 0.012)]
    heights += [(PRESSED_S + 0.1 * k, 0.012 + 0.004 * (k % 2)) for k in range(1, 10)]
    heights += [(LEAVES_S, 0.012), (LEAVES_S + 0.3, 0.028)]
    points = [{"time_s": t, "hip_m": [0.065, -0.005, z], "handle_rad": 0.5} for t, z in heights]
    script.write_text(yaml.safe_dump({"loop": False, "motions": {"left": {"breakpoints": points}}}))
    arm = {"driver": "phantom_simulated", "device": "phantom_premium_1_5", "settings": {"script": str(script)}}
    can_bus = {"interface": "virtual", "channel": str(folder)}
    grasp = {"driver": "grasp_odrive_can", "device": "grasp_odrive", "settings": {"bus": can_bus}}
    row = {
        "name": "left", "port_m": [0.075, -0.060, 0.120], "arm": arm, "grasp": grasp,
        "mount": {"centre_m": [0.065, -0.005, 0.020], "yaw_rad": 1.5708},
    }  # fmt: skip
    settings = {
        "instruments": [row], "engage_ramp_s": 0.1, "supervisor_timeout_s": None, "force_limit_n": LIMIT_N,
        "force_rate_limit_n_s": RATE_N_S, "grasp_torque_limit_nm": TORQUE_NM,
    }  # fmt: skip
    file = folder / "rig.yaml"
    file.write_text(yaml.safe_dump({"name": "drill", "gateway": settings}))
    return file
