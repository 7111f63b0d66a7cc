"""Keeps the course of an attempt as it happens, and measures it at its end."""

from __future__ import annotations

from array import array

import numpy as np

from trocar.protocol.bodies import GatewayState
from trocar.protocol.topics import TICK_S
from trocar.review.attempts.motion import Values
from trocar.services.training.procedure import PHASES, Procedure
from trocar.services.training.situation import EVERY_TICKS, TISSUES, Situation

HANDS = 2  # more have no columns: a scene for training has at most two tools
_PHASE_NUMBERS = {phase: number for number, phase in enumerate(PHASES)}
_WIDTH = 6 + len(TISSUES) + HANDS
_HAND = 6  # numbers of a hand: three for its position, three for its port


class Trace:
    """Rows of numbers: one a situation, and one for every fourth tick of the devices, which are recorded whole."""

    def __init__(self) -> None:
        self._rows, self._ways = array("d"), array("d")
        self._due_tick = 0
        self.names: list[str] = []
        self.has_force = True

    def take_situation(self, s: Situation, p: Procedure) -> None:
        """Add a situation that the procedure has taken."""
        self._rows.extend((p.time_s, _PHASE_NUMBERS[p.phase], s.inserted_m, *s.tip_m, *s.tissue_n))
        loads = [hand.load_n for hand in s.hands[:HANDS]]
        self._rows.extend(loads + [0.0] * (HANDS - len(loads)))

    def take_devices(self, state: GatewayState) -> None:
        """Add where the instruments are."""
        if state.tick < self._due_tick:
            return
        self._due_tick = state.tick + EVERY_TICKS
        told = state.instruments[:HANDS]
        self.names = [each.name for each in told]
        self.has_force = self.has_force and all(each.has_force for each in told)
        self._ways.append(state.tick * TICK_S)
        for each in told:
            self._ways.extend((*each.position_m, *each.port_m))
        self._ways.extend([0.0] * (_HAND * (HANDS - len(told))))

    def columns(self) -> Columns:
        """Return the series so far."""
        rows = np.array(self._rows, np.float64).reshape(-1, _WIDTH)
        return Columns(rows, np.array(self._ways, np.float64).reshape(-1, 1 + _HAND * HANDS), self.names)


class Columns:
    """The series of a trace by name: times in s, lengths in m, forces in N; `names` are those of the hands.

    Attributes:
        time_s, phase, inserted_m, tip_m, tissue_n, load_n: (n,) or (n, ...) of the situations; loads are those on the
            hands.
        way_s, position_m, port_m: (k,), (k, 2, 3) and (k, 2, 3) of the devices.
    """

    def __init__(self, rows: Values, ways: Values, names: list[str]) -> None:
        self.names = names
        self.time_s = rows[:, 0]
        self.phase = rows[:, 1].astype(int)
        self.inserted_m = rows[:, 2]
        self.tip_m = rows[:, 3:6]
        self.tissue_n = rows[:, 6 : 6 + len(TISSUES)]
        self.load_n = rows[:, 6 + len(TISSUES) :]
        self.way_s = ways[:, 0] - ways[0, 0] if len(ways) else ways[:, 0]
        hands = ways[:, 1:].reshape(len(ways), HANDS, _HAND)
        self.position_m, self.port_m = hands[:, :, :3], hands[:, :, 3:]
