"""One episode: hands move, the scene follows, and the training procedure judges it like a person's attempt."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from trocar.envs.frames import TICK_NS, Framer
from trocar.envs.hands import DeviceHands
from trocar.envs.recording import EpisodeRecording
from trocar.envs.stage import Stage
from trocar.protocol import Frame
from trocar.protocol.topics import TICK_S
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.training.judge import Judge
from trocar.services.training.scenario import Scenario
from trocar.services.training.score import ScoreRules
from trocar.services.training.trainer import Trainer

FAST = ("gateway.state", "haptics.contacts", "physics.state")
"""Topics of an observation."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """State of an episode by the procedure.

    ``cost_s`` is the sum of the penalties of all errors so far, ``score`` the total of a completed episode, -1 before.
    """

    outcome: str = ""
    reason: str = ""
    phase: str = ""
    time_s: float = 0.0
    depth_m: float = 0.0
    cost_s: float = 0.0
    errors: dict[str, int] = field(default_factory=dict)
    score: float = -1.0

    @property
    def ended(self) -> bool:
        """Whether it is completed."""
        return bool(self.outcome)


class Episode:
    """An attempt at a scenario, starting at rest.

    Args:
        stage: Stage. Stage at its start.
        hands: DeviceHands. Hands at their start.
        path: Path, optional. Path of a recording to write.
    """

    def __init__(
        self, stage: Stage, hands: DeviceHands, scenario: Scenario, rules: ScoreRules, path: Path | None = None
    ) -> None:
        self.simulation, self._hands, self._rules = stage.simulation, hands, rules
        self.simulation.is_felt = path is not None  # stiffness is only for hands and recordings
        self._grips = stage.grips
        self._framer = Framer(self.simulation, self._grips, hands)
        self._recording = EpisodeRecording(path, stage, self._framer) if path is not None else None
        self._trainer = Trainer(scenario, judges=lambda each: Judge(each, stage.site), rules=rules, ways=stage.ways)
        self._told: tuple[object, ...] = ()
        self.tick = 0
        self.frames: dict[str, Frame] = {}
        if self._recording is not None:
            self._tell(-1)  # before any hand moves, so that readers find an attempt at the start
        self._grips.follow_hands(hands.state, None)
        self._look(self._framer.devices(0, hands.state))
        self._follow()

    @property
    def time_s(self) -> float:
        """Simulated time since the start."""
        return self.tick * TICK_S

    def advance(self, ticks: int) -> None:
        """Advance by ``ticks`` with the present rates of the hands; the procedure observes the end."""
        length = self.simulation.rung.ticks_per_step
        devices, last = None, self.tick + ticks - length
        for _ in range(ticks // length):
            if self.tick:
                self._framer.measure_inserted(self.tick, last)
            before = self._hands.state.copy() if self._recording is not None else None
            self._hands.move(length * TICK_S)
            self._step(length)
            if before is not None:
                devices = self._tell_devices(before, length)
        self._look(devices or self._framer.devices(self.tick, self._hands.state))
        self._follow()

    def _step(self, length: int) -> None:
        """Update the grasps from the last solved state, as haptics does on a rig, and take a step."""
        newest = partial(self._framer.state, self.tick) if self.tick else None
        self._hands.inputs.holds = self._grips.follow_hands(self._hands.state, newest)
        self.simulation.step(self._hands.inputs, length * TICK_S)
        self.tick += length
        self._framer.feel()

    def verdict(self) -> Verdict:
        """Return the present state by the procedure."""
        attempt, judge = self._trainer.attempt, self._trainer.observer.judge
        cost_s = sum(map(self._rules.penalty, judge.events)) if judge is not None and attempt.errors else 0.0
        return Verdict(
            outcome=attempt.outcome, reason=attempt.reason, phase=attempt.phase, time_s=attempt.time_s,
            depth_m=attempt.depth_m, cost_s=cost_s, errors=dict(attempt.errors), score=self._trainer.score,
        )  # fmt: skip

    def close(self) -> None:
        """End the episode; an incomplete one is abandoned."""
        if self._recording is None:
            return
        if not self._trainer.attempt.ended:
            self._trainer.attempt.abandon("the episode was left")
            self._tell(self.tick)
        self._recording.close()
        self._recording = None

    def _tell_devices(self, before: FloatArray, length: int) -> Frame | None:
        """Record the devices of each tick of a step; return the last frame."""
        assert self._recording is not None
        frame, after = None, self._hands.state
        for k in range(1, length + 1):
            at: FloatArray = after if k == length else before + k / length * (after - before)
            frame = self._framer.devices(self.tick - length + k, at)
            self._recording.append_tick(frame, length if k == length else 0)
        return frame

    def _look(self, devices: Frame) -> None:
        """Pass the present state to the procedure."""
        contacts, state = self._framer.solved(self.tick)
        self.frames = {each.topic: each for each in (devices, contacts, state)}
        self._trainer.observer.take_frames(self.frames, self.tick * TICK_NS)
        if self._recording is not None:
            if self.tick == 0:
                self._recording.append_tick(devices, 0)
            self._recording.append_frame(contacts)
            self._recording.append_frame(state)

    def _follow(self) -> None:
        self._trainer.follow_attempt(self.time_s)
        if self._recording is not None:
            if self._trainer.gist() != self._told:
                self._tell(self.tick)
            self._recording.write_due()

    def _tell(self, tick: int) -> None:
        assert self._recording is not None
        self._told = self._trainer.gist()
        self._recording.append_frame(self._framer.frame(tick, self._trainer.body(), "training.attempt"))


def nearest_m(point_m: FloatArray, points_m: FloatArray) -> float:
    """Return the distance of a point (3,) to the nearest of some (n, 3)."""
    away: FloatArray = points_m - point_m
    return float(np.sqrt(np.einsum("ij,ij->i", away, away).min()))
