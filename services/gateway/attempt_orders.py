"""Orders about the rig's time: how fast it goes, that the scene begins again; it stands until the rig is up."""

from __future__ import annotations

from protocol import Frame
from services.gateway.instrument import Instrument
from services.gateway.rig_time import RigTime


class AttemptOrders:
    """Obeys ``training.attempt``; no arm bears a force while a scene begins again, or time does not go as the clock.

    First every hand is let go, at the rate limit. Then the scene begins, or time stands; force comes back by
    re-engagement once time goes again. Without a training process that speaks, it goes. While the supervisor says that
    the rig starts, it stands: a step of physics is most of what the loops compute, and who is not ready yet needs that.

    Attributes:
        starting: Whether the supervisor says so.
        begins: How often the scene was begun again: travels in every frame, so that all begin with the same tick.
    """

    def __init__(self, instruments: list[Instrument], time: RigTime) -> None:
        self.begins = 0
        self.starting = False
        self._instruments, self._time = instruments, time
        self._by = -1, 0, 0  # who orders, with how many begins and steps so far
        self._pace = 1.0
        self._begins_owed = self._acts = False

    def obey(self, frame: Frame | None, fresh: bool) -> None:
        """Follow the newest frame, where there is one; `fresh` is whether the last is young enough to be followed."""
        if frame is not None:
            body = frame.body
            by, begins, steps = self._by
            if by == frame.incarnation:
                self._begins_owed |= body.begins > begins
                if self._time.pace == 0.0:
                    self._time.step(max(body.steps - steps, 0))
            self._by = frame.incarnation, body.begins, body.steps
            self._pace = body.pace
        if not fresh:
            self._pace = 1.0
        if self.starting:
            self._pace = 0.0
        self._acts |= self._begins_owed or self._pace != self._time.pace

    def turn(self) -> None:
        """Carry out what is asked for as soon as every hand is limp; to be called in each tick of the loop."""
        if not self._acts:
            return
        rests = self._begins_owed or self._pace != 1.0
        for instrument in self._instruments:
            instrument.servo.engagement.rests = rests
        if rests and not all(instrument.servo.limp for instrument in self._instruments):
            return
        if self._begins_owed:
            self._begin()
            return  # in the next tick time and force go on
        self._time.pace = self._pace
        for instrument in self._instruments:
            instrument.keep_pace(self._pace)
        self._acts = False

    def _begin(self) -> None:
        self._begins_owed = False
        self.begins += 1
        for instrument in self._instruments:
            instrument.begin_again()
