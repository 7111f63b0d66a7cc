"""The roll of a tool by how a grip is turned, which another program tells and may tell wrong."""

from __future__ import annotations

import math

from trocar.services.gateway.servo.slew import slew

#: No hand turns a grip faster, rad/s: five turns a second. An assumption, which only smooths what is told wrong.
_FASTEST_RAD_S = 30.0


class GripRoll:
    """Turn about the grip's axis, rad; it goes on beyond a full turn, and no faster than a hand."""

    def __init__(self) -> None:
        self.roll_rad = 0.0
        self._told_ns = 0

    def take_turn(self, turn_rad: float, told_ns: int) -> None:
        """Take a turn, known but for full turns."""
        passed_s = min(max(0.0, 1e-9 * (told_ns - self._told_ns)), 1.0)
        self._told_ns = told_ns
        wanted = self.roll_rad + math.remainder(turn_rad - self.roll_rad, 2.0 * math.pi)
        self.roll_rad = slew(self.roll_rad, wanted, _FASTEST_RAD_S * passed_s)
