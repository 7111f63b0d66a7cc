"""The journal of a loop: its inputs, so that a recording can be replayed (`trocar.protocol.bodies.Journal`)."""

from __future__ import annotations

import numpy as np

from trocar.protocol.arrays import pack
from trocar.protocol.bodies.journal import RUN_COLUMNS, Journal
from trocar.services.runtime.bus.bus import Bus

#: Number of ticks in a journal: eight are sent a second, fewer than the topic's ten, and a crash loses the last 0.13 s.
_TICKS = 128


class JournalWriter:
    """Run-length encodes ticks; a tick like the last costs one comparison."""

    def __init__(self, topic: str, bus: Bus) -> None:
        self._topic, self._bus = topic, bus
        self._runs: list[list[int]] = []
        self._facts: tuple[int, int, int] | None = None
        self._tick = self._sent = self._waiting = 0

    def note(self, tick: int, facts: tuple[int, int, int]) -> None:
        """Record a tick of the rig's clock and its inputs; repetitions of a tick are ignored."""
        if self._facts is not None and tick == self._tick:
            return
        step, self._tick = tick - self._tick, tick
        self._waiting += 1
        if facts == self._facts and self._runs:
            run = self._runs[-1]
            if run[1] == 1:
                run[2] = step
            if run[2] == step:
                run[1] += 1
                return
        self._facts = facts
        self._runs.append([tick, 1, 1, *facts])

    def send_if_due(self) -> bool:
        """Send the journal if it is complete; return whether it was."""
        if self._waiting < _TICKS:
            return False
        self.send()
        return True

    def send(self) -> None:
        """Send the journal."""
        runs = pack(np.array(self._runs, np.int64).reshape(-1, RUN_COLUMNS), "<i8")
        self._bus.publish(self._topic, Journal(noted=self._sent, runs=runs))
        self._sent += self._waiting
        self._waiting, self._runs = 0, []
