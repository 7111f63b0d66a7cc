"""Haptics in a replay: each recorded device frame is answered from the state that was known at the recording."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Generic, Protocol, TypeVar, cast

from trocar.protocol import Frame
from trocar.services.recordings.injected_bus import InjectedBus, InjectedProcess
from trocar.services.recordings.schedule import ASK_AGAIN_NS, Schedule
from trocar.services.runtime.process.process import Process

#: States of physics that haptics may not have used yet: it sees one of the last five ticks, or none that is fresh.
STATES_KEPT = 64


class Answering(Protocol):
    """Haptics on some bus."""

    def answer(self, frame: Frame) -> None:
        """Answer a device frame."""

    def do_side_work(self) -> None:
        """Run background work between two ticks."""


H = TypeVar("H", bound=Answering)


class ReplayedHaptics(Generic[H]):
    """Answers like the `Haptics` that `make` constructs, with the states of physics recorded for each tick."""

    def __init__(self, process: Process, make: Callable[[Process], H], schedule: Schedule) -> None:
        self._process, self._make, self._schedule = process, make, schedule
        self._begin_replay()

    def _begin_replay(self) -> None:
        process = self._process
        self._bus = InjectedBus(process.bus)
        self._haptics = self._make(cast(Process, InjectedProcess(self._bus, process.health, process.log)))
        self._states: dict[int, Frame] = {}
        self._answered = self._seen = -1

    def do_side_work(self) -> None:
        """Run background work between two ticks."""
        self._haptics.do_side_work()

    def answer(self, frame: Frame) -> None:
        """Answer a frame as in the recording; a frame of an earlier tick restarts the replay first."""
        tick = frame.body.tick
        intake = self._schedule.intakes.get(tick)
        if tick == self._answered:
            self._bus.republish("haptics.contact_model")
            return
        if tick < self._answered:
            self._begin_replay()
        self._answered = tick
        self._bus.is_live = intake is None
        if intake is not None:
            self._wait_for(self._schedule.awaited[tick])
            if intake.seen_tick != self._seen:  # a state is delivered once
                self._bus.frame, self._seen = self._states.get(intake.seen_tick), intake.seen_tick
            self._bus.is_fresh_now = intake.is_fresh
        self._haptics.answer(frame)

    def _wait_for(self, tick: int) -> None:
        """Wait until physics has computed the state of a tick; send contacts again in case they were lost."""
        bus = self._process.bus
        while tick >= 0 and tick not in self._states and not self._process.stop():
            if not bus.wait("physics.state", time.monotonic_ns() + ASK_AGAIN_NS):
                self._bus.republish("haptics.contacts")
                self._process.health.send_if_due()
                continue
            state = bus.latest("physics.state")
            if state is not None:
                self._states[state.body.tick] = state
                while len(self._states) > STATES_KEPT:
                    del self._states[next(iter(self._states))]
