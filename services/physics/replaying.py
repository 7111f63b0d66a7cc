"""Physics in a replay: it steps with the contacts that it stepped with at the recording."""

from __future__ import annotations

from typing import Protocol

from trocar.protocol import Frame
from trocar.services.recordings.schedule import Schedule


class Stepping(Protocol):
    """Physics."""

    follows_orders: bool

    @property
    def has_partial_step(self) -> bool:
        """Whether ticks wait for others to complete a step."""

    def obey(self, level: int) -> None:
        """Set a quality level."""

    def advance(self, frame: Frame, ticks: int) -> None:
        """Advance by some ticks."""

    def republish(self, frame: Frame) -> None:
        """Publish the state for a frame again."""

    def begin_again(self) -> None:
        """Restart the scene."""


class ReplayedPhysics:
    """Steps as recorded, and recognises frames that are not of the recording."""

    def __init__(self, physics: Stepping, schedule: Schedule) -> None:
        self._physics, self._schedule = physics, schedule
        self._stepped: Frame | None = None

    def replay_frame(self, frame: Frame) -> bool:
        """Step with a frame of the recording; return False for any other frame."""
        tick = frame.body.tick
        intake = self._schedule.intakes.get(tick)
        self._physics.follows_orders = intake is None
        if intake is None:
            return False
        if self._stepped is not None and tick <= self._stepped.body.tick:
            if tick == self._stepped.body.tick:
                self._physics.republish(self._stepped)
                return True
            self._physics.begin_again()
        if intake.ticks:
            self._stepped = frame
            self._physics.obey(intake.level)
            self._physics.advance(frame, intake.ticks)
            if self._physics.has_partial_step:  # haptics waits until its contacts are used
                self._physics.republish(frame)
        return True
