"""The roll of a tool by how its grip is held, and the grip's buttons."""

from __future__ import annotations

import math

from trocar.services.gateway.devices.grip_roll import GripRoll
from trocar.services.gateway.haply.messages import GripEntry, Wxyz

#: How far from one the norm of an orientation may be, as numbers of 32 bits are exact to 1e-7, and another format is
#: far off.
_NEARLY = 0.1
#: A grip held across the arm, whose turn about its own axis is not known: beyond this, 32 bits tell it to 1e-4 rad.
_ACROSS = 1e-3


class Grip:
    """Roll and buttons of one grip, as last told.

    Attributes:
        awake: bool. Whether the newest answer told them.
    """

    def __init__(self, axis: str) -> None:
        self.awake = False
        self.buttons = 0
        self._axis = axis
        self._roll = GripRoll()

    @property
    def roll_rad(self) -> float:
        """The tool's roll."""
        return self._roll.roll_rad

    def take_entry(self, entry: GripEntry | None, told_ns: int) -> None:
        """Take what was told of the grip, None if nothing was; a grip that sleeps keeps its roll."""
        asleep = entry is None or False in (entry.status.awake, entry.status.connected)
        turn = None if entry is None or asleep else twist_rad(entry.state.orientation, self._axis)
        self.awake = turn is not None
        self.buttons = 0
        if entry is None or turn is None:
            return
        self._roll.take_turn(turn, told_ns)
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
