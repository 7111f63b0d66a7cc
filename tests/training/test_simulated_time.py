"""In simulated time an attempt has the same score whoever is late, and however often: to the bit."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any, cast

import pytest
import yaml

import trocar.services.gateway.__main__ as gateway_process
import trocar.services.haptics.__main__ as haptics_process
from benchmarks.make_samples import COARSE
from tests.memory_bus import MemoryBus, MemoryHub
from tests.memory_process import MemoryProcess, in_time_of
from trocar.protocol import bodies
from trocar.review.attempts.assess import Terms, assess
from trocar.services.files.cache_directory import cache_directory
from trocar.services.gateway.motions.scene_hands import SceneHands
from trocar.services.physics import __main__ as physics_process
from trocar.services.runtime.config.config import load_rig
from trocar.services.runtime.loop.loop import LoopMeter, Tick, TickClock
from trocar.services.runtime.loop.tick_grid import MOMENTS, Moments, as_state
from trocar.services.scenes import load_duct, load_scene
from trocar.services.training.judge import Judge
from trocar.services.training.scenario import Goal, Limit, Scenario
from trocar.services.training.score import load_rules
from trocar.services.training.trainer import Trainer

TICK_NS = 1_000_000
_MOST_MS = 20_000
HANDS = Path("docs/examples/recordings/insertion-success.mcap").absolute()
SCENARIO = Scenario(
    name="short", title="Short", scene="insertion", goal=Goal(depth_m=0.005, hold_s=0.1, time_limit_s=2.5),
    limits={"crush_force_n": Limit(value=0.01), "counter_traction_n": Limit(value=0.2)},
)  # fmt: skip


class RigOfLateLoops:
    """Gateway, haptics, physics and training in memory; `chance` is the share of turns in which each of them runs."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch, chance: float) -> None:
        self.now_ns = 10**12
        in_time_of(monkeypatch, lambda: self.now_ns, self._sleep_until)
        monkeypatch.setattr(haptics_process, "time", gateway_process.time)
        self._dice, self._chance = random.Random(7), chance
        hub, rig, scene = MemoryHub(), load_rig(_rig_file(folder)), load_scene("insertion", COARSE)
        assert rig.simulated_time
        duct = load_duct(scene, cache_directory(), lambda *_: None)
        gateway, haptics, physics = (MemoryProcess(name, hub, rig) for name in ("gateway", "haptics", "physics"))
        self.gateway = gateway_process.Gateway(cast(Any, gateway), SceneHands())
        meters = [LoopMeter(1000.0, stages) for stages in (haptics_process.STAGES, physics_process.STAGES)]
        self.haptics = haptics_process.Haptics(cast(Any, haptics), meters[0], scene, duct, in_step=True)
        self.physics = physics_process.Physics(cast(Any, physics), meters[1], scene, duct, in_step=True)
        self._clock, self._haptics_bus, self._physics_bus = TickClock(meters[1]), haptics.bus, physics.bus
        self._listener, self._moments = MemoryBus(hub, reads_every=("gateway.state", *MOMENTS)), Moments()
        self.trainer = Trainer(SCENARIO, None, (), lambda each: Judge(each, None), load_rules(), simulated=True)
        self.recorded: list[tuple[str, int, Any]] = []
        self.gateway.open()
        self._index = -1

    def _sleep_until(self, deadline_ns: int) -> None:
        self.now_ns = max(self.now_ns, deadline_ns)

    def _is_run(self) -> bool:
        return self._dice.random() < self._chance

    def turn(self) -> None:
        """Let a millisecond pass, or more where the gateway itself is not run."""
        self._index += 1 if self._is_run() else self._dice.randrange(2, 4)
        due_ns = 10**12 + self._index * TICK_NS
        self._sleep_until(due_ns)
        self.gateway.tick(Tick(self._index, due_ns, self.now_ns))
        devices = self._haptics_bus.latest("gateway.state") if self._is_run() else None
        if devices is not None:
            self.haptics.answer(devices)
        contacts = self._physics_bus.latest("haptics.contacts") if self._is_run() else None
        if contacts is not None:
            self.physics.advance(contacts, self._clock.steps(contacts.body.tick))
        self.gateway.serve(due_ns + TICK_NS)
        if self._is_run():
            self._look()

    def _look(self) -> None:
        moments = [frame for name in MOMENTS for frame in self._listener.drain(name)]
        kept = [*self._listener.drain("gateway.state"), *map(as_state, moments[:])]
        self.recorded += [(each.topic, each.sent_ns, each.body) for each in sorted(kept, key=lambda f: f.sent_ns)]
        for moment in self._moments.take_frames(moments):
            self.trainer.observer.take_frames(moment, self.now_ns)
            self.trainer.follow_attempt(self.now_ns * 1e-9)
        self.recorded.append(("training.attempt", self.now_ns, self.trainer.body()))

    def run(self) -> bodies.Attempt:
        while not self.trainer.attempt.ended and self._index < _MOST_MS:
            self.turn()
        self._look()
        return self.trainer.body()

    def tip_m(self) -> list[float]:
        state = self.trainer.observer._physics
        assert state is not None
        return list(state.catheter.position_m.view()[-1])


def _rig_file(folder: Path) -> Path:
    hand = {"driver": "replay", "settings": {"file": str(HANDS), "loop": False}}
    jaws = {"driver": "grasp_replay", "settings": {"file": str(HANDS), "loop": False}}
    rows = [{"name": name, "arm": hand, "grasp": jaws} for name in ("left", "right")]
    file = folder / "rig.yaml"
    file.write_text(yaml.safe_dump({"name": "late", "base": "stub", "gateway": {"instruments": rows}}))
    return file


def _told(attempt: bodies.Attempt) -> tuple[Any, ...]:
    return attempt.outcome, attempt.score, attempt.time_s, attempt.depth_m, attempt.errors, attempt.counts


def test_late_loops_change_nothing_of_an_attempt(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    prompt = RigOfLateLoops(tmp_path, monkeypatch, 1.0)
    told = prompt.run()
    late = RigOfLateLoops(tmp_path, monkeypatch, 0.93)
    told_late = late.run()
    assert told.state == "done"
    assert told.errors
    assert _told(told_late) == _told(told)
    assert late.trainer.observer.judge.events == prompt.trainer.observer.judge.events  # type: ignore[union-attr]
    assert late.tip_m() == prompt.tip_m()
    assert told.counts
    assert told_late.until_tick - told_late.from_tick == told.until_tick - told.from_tick
    for rig, live in ((prompt, told), (late, told_late)):
        terms = Terms(scenario_of=lambda _: SCENARIO, rules=load_rules())
        (found,) = assess(rig.recorded, terms)
        assert found.score is not None
        assert (found.score.total, found.time_s) == (live.score, live.time_s)
        assert found.errors == rig.trainer.observer.judge.events  # type: ignore[union-attr]
        assert found.rig.lost_ticks == 0.0
