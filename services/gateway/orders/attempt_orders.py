"""Orders about the rig's time: its pace, and restarts of the scene. The time is stopped until the rig is up."""

from __future__ import annotations

from trocar.protocol import Frame
from trocar.protocol.topics import MOMENT_TICKS
from trocar.services.gateway.instruments.instrument import Instrument
from trocar.services.gateway.orders.rig_time import RigTime


class AttemptOrders:
    """Follows ``training.attempt``. No arm bears a force during a restart, or when the time differs from the clock.

    First all forces are reduced to zero at the rate limit. Then the scene restarts, or time stops; forces return by
    re-engagement once time runs again. It also runs if no training process is heard. It is stopped while the supervisor
    reports that the rig starts, because steps of physics would take the time that starting processes need.

    Attributes:
        starting: Whether the supervisor reports that the rig starts.
        begins: Number of restarts of the scene; it is in every frame, so that all processes restart at the same tick.
    """

    def __init__(self, instruments: list[Instrument], time: RigTime) -> None:
        self.begins = 0
        self.starting = False
        self._instruments, self._time = instruments, time
        self._by = -1, 0, 0  # incarnation of the sender, its restarts and steps so far
        self._pace = 1.0
        self._begins_owed = self._acts = False

    def obey_frame(self, frame: Frame | None, fresh: bool) -> None:
        """Follow the newest frame, if any; `fresh` tells whether the last one is young enough."""
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

    def execute_orders(self) -> None:
        """Execute orders as soon as no hand bears a force; call this in each tick of the loop."""
        if not self._acts:
            return
        rests = self._begins_owed or self._pace != 1.0
        for instrument in self._instruments:
            instrument.servo.engagement.rests = rests
        if rests and not all(instrument.servo.limp for instrument in self._instruments):
            return
        if self._begins_owed:
            self._begin_attempt()
            return  # time and force continue in the next tick
        self._time.pace = self._pace
        for instrument in self._instruments:
            instrument.keep_pace(self._pace)
        self._acts = False

    def _begin_attempt(self) -> None:
        if self._time.stands:  # physics has made its step of this tick
            self._time.step_soon()
            return
        if self._time.simulated and self._time.index % MOMENT_TICKS:  # so that every attempt is seen at the same ticks
            self._time.step_soon()
            return
        self._begins_owed = False
        self.begins += 1
        for instrument in self._instruments:
            instrument.begin_again()
