"""Own hands take over from a recording: what is written to the arms never steps beyond the rate limit.

The processes are as they are, in process and in time that passes tick by tick; forces are those that the motors get.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import yaml

import trocar.services.gateway.__main__ as gateway_process
from tests.memory_bus import MemoryBus, MemoryHub
from tests.memory_process import MemoryProcess, in_time_of
from tests.physics.conftest import SMALL
from tests.recorder.recorded_rig import RECORDED
from tests.whole_rig import WholeRig, rig_file
from trocar.protocol.bodies import GatewayState
from trocar.services.files.cache_directory import cache_directory
from trocar.services.gateway import replaying
from trocar.services.gateway.drivers.phantom_simulated import Driver
from trocar.services.gateway.motions.scene_hands import SceneHands
from trocar.services.haptics import __main__ as haptics_process
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.physics import __main__ as physics_process
from trocar.services.recorder.recording import RecordingWriter
from trocar.services.recordings.provenance import machine, mechanics_digest
from trocar.services.runtime.config import config
from trocar.services.runtime.loop import loop
from trocar.services.runtime.loop.loop import LoopMeter, TickClock
from trocar.services.scenes import load_duct, load_scene

PRESS = Path(__file__).parents[1] / "rig" / "press.yaml"
PRESSED_S, STRETCH_S, LIVE_TICKS = 1.2, 0.05, 1500
#: So low that the limiter, and nothing else, shapes how the force comes.
RATE_N_S = 2.0


@dataclass(frozen=True)
class Taken:
    """What the motors got in the ticks of own hands, (ticks, arms, 3), and all ticks of the device frames."""

    forces_n: FloatArray
    ticks: FloatArray


class _Process(MemoryProcess):
    """The gateway's, which ends after so many live ticks."""

    live = 0

    def ready(self, _meter: LoopMeter) -> None:
        """Nobody waits for it."""

    def stop(self) -> bool:
        return self.live >= LIVE_TICKS


class TakeOver:
    """A rig that replays a recording, and goes on with the hands of simulated arms."""

    def __init__(self, file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_ns = 10**13
        in_time_of(monkeypatch, lambda: self.now_ns, self._sleep_until)
        passing = SimpleNamespace(monotonic_ns=lambda: self.now_ns, thread_time_ns=lambda: 0)
        for module in (loop, replaying):
            monkeypatch.setattr(module, "time", passing)
        monkeypatch.setattr(replaying, "sleep_until", self._sleep_until)
        write = Driver.write

        def hold(arm: Driver, force_n: FloatArray) -> None:
            write(arm, force_n)
            self._held.setdefault(id(arm), []).append(arm.force_n.copy())

        monkeypatch.setattr(Driver, "write", hold)
        hub, rig = MemoryHub(), config.load_rig(file)
        self._gateway, haptics, physics = (
            _Process("gateway", hub, rig),
            *(MemoryProcess(name, hub, rig) for name in ("haptics", "physics")),
        )
        monkeypatch.setattr(self._gateway.bus, "wait", self._wait)
        scene = load_scene(SMALL)
        prepared = scene, load_duct(scene, cache_directory(), lambda stage, share: None)
        meter = LoopMeter(1000.0, physics_process.STAGES)
        self._clock = TickClock(meter)
        self._haptics = haptics_process._replay(cast(Any, haptics), LoopMeter(1000.0, haptics_process.STAGES), prepared)
        self._physics = physics_process.Physics(cast(Any, physics), meter, *prepared)
        self._replay = physics_process._replay(cast(Any, physics), self._physics)
        self._haptics_bus, self._physics_bus = haptics.bus, physics.bus
        self._listener = MemoryBus(hub, reads_every=["gateway.state"])
        self._held: dict[int, list[FloatArray]] = {}
        self.devices: list[GatewayState] = []

    def run(self) -> FloatArray:
        """Replay, take over, and end in good order; return what the arms got, (ticks, arms, 3)."""
        gateway_process.run(cast(Any, self._gateway), SceneHands())
        return np.array(list(self._held.values())).transpose(1, 0, 2)

    def _sleep_until(self, due_ns: int) -> None:
        self._others()
        self.now_ns = max(self.now_ns, due_ns)

    def _wait(self, name: str, _until_ns: int) -> bool:
        self._others()
        return bool(self._gateway.bus._queues[name])

    def _others(self) -> None:
        devices = self._haptics_bus.latest("gateway.state")
        if devices is None:
            return
        self.devices += [each.body for each in self._listener.drain("gateway.state")]
        assert self._haptics is not None
        assert self._replay is not None
        self._gateway.live += bool(self._held)
        self._haptics.answer(devices)
        contacts = self._physics_bus.latest("haptics.contacts")
        if contacts is not None:
            ticks = self._clock.steps(contacts.body.tick)
            if not self._replay.replay_frame(contacts):
                self._physics.advance(contacts, ticks)
            self._physics.do_side_work()


@pytest.fixture(scope="module")
def pressed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a recording that ends while the left hand presses on the wall."""
    folder = tmp_path_factory.mktemp("pressed")
    with pytest.MonkeyPatch.context() as patch:
        press = {"script": str(PRESS)}
        rig = WholeRig(folder, patch, load_scene(SMALL), (press, press))
        listener = MemoryBus(rig._listener._hub, reads_every=RECORDED)
        writer = RecordingWriter(folder / "a.mcap", {"mechanics": mechanics_digest(), "machine": machine()})
        writer.attach("scene.yaml", "application/yaml", yaml.safe_dump(config.read_scene(SMALL, [])).encode())
        for _ in range(round(PRESSED_S / STRETCH_S)):
            rig.run(STRETCH_S)
            for frame in listener.drain("gateway.state"):
                writer.write(frame)
        rig.haptics._journal.send()
        rig.physics._journal.send()
        for name in ("haptics.journal", "physics.journal"):
            for frame in listener.drain(name):
                writer.write(frame)
        writer.close()
        assert np.linalg.norm(rig.forces_n()[-1, 0]) > 0.02
        rig.gateway.close()
    return writer.path


def _hand(folder: Path, name: str) -> str:
    """Return the script of a hand that stands on the wall where it was pressed, or comes to it."""
    if name == "comes":
        return str(PRESS)
    script = yaml.safe_load(PRESS.read_text())
    script["motions"]["left"]["breakpoints"] = [{**script["motions"]["left"]["breakpoints"][1], "time_s": 0.0}]
    (folder / "stands.yaml").write_text(yaml.safe_dump(script))
    return str(folder / "stands.yaml")


@pytest.fixture(scope="module")
def taken_over(request: pytest.FixtureRequest, pressed: Path, tmp_path_factory: pytest.TempPathFactory) -> Taken:
    """Return what came of it with the hand that a test asks for."""
    folder = tmp_path_factory.mktemp(request.param)
    hand = {"script": _hand(folder, request.param)}
    limits = {"force_rate_limit_n_s": RATE_N_S, "engage_ramp_s": 0.0}
    file = rig_file(folder, load_scene(SMALL), (hand, hand), **limits)
    replay = {"file": str(pressed), "take_over": True}
    file.write_text(yaml.safe_dump({**yaml.safe_load(file.read_text()), "replay": replay}))
    with pytest.MonkeyPatch.context() as patch:
        rig = TakeOver(file, patch)
        forces_n = rig.run()
    return Taken(forces_n, np.array([each.tick for each in rig.devices]))


@pytest.mark.parametrize("taken_over", ["stands", "comes"], indirect=True)
def test_no_hand_gets_a_step_of_force_beyond_the_rate_limit(taken_over: Taken) -> None:
    limp_n = np.zeros((1, *taken_over.forces_n.shape[1:]))
    steps_n = np.linalg.norm(np.diff(np.concatenate((limp_n, taken_over.forces_n)), axis=0), axis=2)
    assert steps_n.max() <= 1e-3 * RATE_N_S * (1 + 1e-9)


@pytest.mark.parametrize("taken_over", ["stands"], indirect=True)
def test_the_force_of_the_wall_comes_at_the_limit_to_a_hand_that_stands_there(taken_over: Taken) -> None:
    """What is asked for at once, by the first model after the hand was armed, comes in many steps."""
    steps_n = np.linalg.norm(np.diff(taken_over.forces_n[:, 0], axis=0), axis=1)
    assert np.sum(steps_n > 0.99e-3 * RATE_N_S) > 5
    assert np.linalg.norm(taken_over.forces_n[LIVE_TICKS - 10, 0]) > 0.02


@pytest.mark.parametrize("taken_over", ["comes"], indirect=True)
def test_the_time_of_the_recording_goes_on(taken_over: Taken) -> None:
    """Were it to begin anew, everybody else would begin the scene anew, too."""
    assert set(np.diff(taken_over.ticks)) == {1}
