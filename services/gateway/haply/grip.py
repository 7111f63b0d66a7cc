"""The roll of a tool by how its grip is held, and the grip's buttons."""

from __future__ import annotations

import math

from trocar.services.gateway.haply.messages import GripEntry, Wxyz
from trocar.services.gateway.slew import slew

#: No hand turns a grip faster, rad/s; and how far from one the norm of an orientation may be.
_FASTEST_RAD_S, _NEARLY = 30.0, 0.1
#: A grip held across the arm, whose turn about its own axis is not known.
_ACROSS = 1e-3


class Grip:
    """Roll and buttons of one grip, as last told.

    Attributes:
        awake: bool. Whether the newest answer told them.
        roll_rad: float. Turn about the grip's axis; it goes on beyond a full turn.
    """

    def __init__(self, axis: str) -> None:
        self.awake = False
        self.roll_rad = 0.0
        self.buttons = 0
        self._axis = axis
        self._told_ns = 0

    def take(self, entry: GripEntry | None, told_ns: int) -> None:
        """Take what was told of the grip, None if nothing was; a grip that sleeps keeps its roll."""
        asleep = entry is None or False in (entry.status.awake, entry.status.connected)
        turn = None if entry is None or asleep else twist_rad(entry.state.orientation, self._axis)
        self.awake = turn is not None
        self.buttons = 0
        if entry is None or turn is None:
            return
        passed_s = max(0.0, 1e-9 * (told_ns - self._told_ns))
        self._told_ns = told_ns
        wanted = self.roll_rad + math.remainder(turn - self.roll_rad, 2.0 * math.pi)
        self.roll_rad = slew(self.roll_rad, wanted, _FASTEST_RAD_S * min(passed_s, 1.0))
        pressed = entry.state.buttons
        self.buttons = (pressed.a or entry.state.button) | pressed.b << 1 | pressed.c << 2


def twist_rad(orientation: Wxyz | None, axis: str) -> float | None:
    """Return the turn of an orientation about one of its own axes, None if it has none."""
    if orientation is None:
        return None
    parts = [orientation.w, orientation.x, orientation.y, orientation.z]
    numbers = [part for part in parts if part is not None]
    along = numbers[1 + "xyz".index(axis)] if len(numbers) == len(parts) else math.nan
    if not abs(math.hypot(*numbers) - 1.0) < _NEARLY or not math.hypot(numbers[0], along) > _ACROSS:
        return None
    return 2.0 * math.atan2(along, numbers[0])
