"""What has been tried in vain from where a world rests: it is not tried again until something about it has changed.

Where nothing of a part of a step can happen, everything rests where it was. Another part of the same length, with the
same hands, begins with the same state and has the same end, in this tick or in a later one, unless a try has found
places that are too deep without a row. So it is divided at once, or does not happen. That holds until a hand has moved
by more than an overlap that is tolerated, which is what a try could find anew, or until a load or the state is another.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from trocar.services.mechanics.arrays import AnyArray, FloatArray
from trocar.services.mechanics.compiled.memory import SavedArrays
from trocar.services.mechanics.scene.tools import GraspHold, ToolInputs
from trocar.services.mechanics.world import World


class StuckWorld:
    """Keeps which lengths of a part have failed from the present rest.

    Args:
        tolerance_m: float. Motion of a hand that is too small to change anything.
    """

    def __init__(self, world: World, tolerance_m: float) -> None:
        tools, duct, catheter = world.tools, world.duct, world.catheter
        loads = duct.constant_modal_force, catheter.constant_force_n
        state = [array for body in (duct, catheter, tools) for array in body.state_arrays()]
        state += [array for effect in world.effects for array in effect.state_arrays()]
        self._saved = SavedArrays([*loads, *state])
        # What a turn of the handle, or of the jaws about the shaft, moves a jaw's tip by.
        jaws_m = tools.arrays.jaw_length
        self._least_m = tolerance_m
        self._least_rad = np.divide(tolerance_m, jaws_m, out=np.zeros_like(jaws_m), where=jaws_m > 0.0)
        self._rests, self._failed_s = False, set[float]()
        self._present, self._place_m, self._turn_rad, self._holds = _pose(ToolInputs())

    def begin(self, hands: ToolInputs) -> bool:
        """Begin a tick with these hands; where they are others, any length may be tried again.

        Return whether the world is as it came to rest, unless it has not.
        """
        if not self._rests:
            return True
        if not self._hands_rest(hands):
            self._failed_s.clear()
            self._note_hands(hands)
        return self._saved.are_as_saved()

    def fails(self, dt_s: float) -> bool:
        """Return whether a part of this length has failed from here."""
        return dt_s in self._failed_s

    def note_failed(self, dt_s: float) -> None:
        """Enter a part that was not sound as a whole, and has been undone."""
        if self._rests:
            self._failed_s.add(dt_s)

    def note_rest(self, hands: ToolInputs) -> None:
        """Enter that nothing of a part has happened, so that everything rests. Only the first one began in motion."""
        if not self._rests:
            self._rests = True
            self._note_hands(hands)
            self._saved.save()

    def forget(self) -> None:
        """Know nothing, because something has moved or is another."""
        self._rests = False
        self._failed_s.clear()

    def _note_hands(self, hands: ToolInputs) -> None:
        self._present, self._place_m, self._turn_rad, self._holds = _pose(hands)

    def _hands_rest(self, hands: ToolInputs) -> bool:
        present, place_m, turn_rad, holds = _pose(hands)
        moved_m, turned_rad = np.abs(place_m - self._place_m), np.abs(turn_rad - self._turn_rad)
        return bool(
            np.array_equal(present, self._present)
            and (moved_m <= self._least_m).all()
            and (turned_rad <= self._least_rad).all()
            and holds == self._holds
        )


def _pose(hands: ToolInputs) -> tuple[AnyArray, FloatArray, FloatArray, tuple[Any, ...]]:
    """Return which tools are present, their positions (2, 3), their angles (2, 2), and what tells their holds apart."""
    angles_rad = np.stack([hands.roll_rad, hands.jaw_angle_rad])
    return hands.present.copy(), hands.position_m.copy(), angles_rad, _names(hands.holds or ())


def _names(holds: Iterable[GraspHold]) -> tuple[Any, ...]:
    return tuple((hold.hold_id, hold.tool, hold.limit_n) for hold in holds)
