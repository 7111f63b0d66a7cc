"""Physics in a replay: of the contacts it steps with those that it stepped with when the recording was made."""

from __future__ import annotations

from typing import Protocol

from protocol import Frame
from services.recordings.schedule import Schedule


class Stepping(Protocol):
    """Physics."""

    follows_orders: bool

    @property
    def owes(self) -> bool:
        """Whether ticks wait for others to make up a whole step."""

    def obey(self, level: int) -> None:
        """Take a quality level."""

    def advance(self, frame: Frame, ticks: int) -> None:
        """Go on by some ticks."""

    def say_again(self, frame: Frame) -> None:
        """Publish the state that answers a frame once more."""

    def begin_again(self) -> None:
        """Begin the scene anew."""


class ReplayedPhysics:
    """Steps as recorded, and says which frames are new."""

    def __init__(self, physics: Stepping, schedule: Schedule) -> None:
        self._physics, self._schedule = physics, schedule
        self._stepped: Frame | None = None

    def take(self, frame: Frame) -> bool:
        """Step with a frame of the recording; return False for one that is not of it."""
        tick = frame.body.tick
        intake = self._schedule.intakes.get(tick)
        self._physics.follows_orders = intake is None
        if intake is None:
            return False
        if self._stepped is not None and tick <= self._stepped.body.tick:
            if tick == self._stepped.body.tick:
                self._physics.say_again(self._stepped)
                return True
            self._physics.begin_again()
        if intake.ticks:
            self._stepped = frame
            self._physics.obey(intake.level)
            self._physics.advance(frame, intake.ticks)
            if self._physics.owes:  # haptics waits until its contacts were taken
                self._physics.say_again(frame)
        return True
