"""Telling of a world in which nothing can move: it is not tried again until something about it has changed.

A tick of which nothing has happened leaves everything at rest where it was. If the next one with the same hands has the
same end, so would all that follow: they begin with the same state. They are left out until a hand has moved by more
than an overlap that is tolerated, which is what a try could find anew, or until a load or the state is another.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from trocar.services.mechanics.arrays import AnyArray, FloatArray
from trocar.services.mechanics.compiled.memory import SavedArrays
from trocar.services.mechanics.scene.tools import GraspHold, ToolInputs
from trocar.services.mechanics.world import World

#: Ticks without motion, one after the other, after which a world is stuck: the first may begin in motion.
TICKS = 2


class StuckWorld:
    """Knows whether another tick would do nothing either.

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
        self._ticks, self._dt_s, self._holds = 0, 0.0, ()
        self._present, self._place_m, self._turn_rad = _pose(ToolInputs())

    def is_stuck(self, hands: ToolInputs, dt_s: float) -> bool:
        """Return whether a tick of this length with these hands would do nothing."""
        if self._ticks < TICKS or dt_s != self._dt_s:
            return False
        return self._hands_rest(hands) and self._saved.are_as_saved()

    def note(self, hands: ToolInputs, dt_s: float, *, moved: bool) -> None:
        """Enter a tick that has been tried, and whether anything has moved in it."""
        if moved:
            self._ticks = 0
            return
        if self._ticks == 0 or dt_s != self._dt_s or not self._hands_rest(hands) or not self._saved.are_as_saved():
            self._ticks, self._dt_s, self._holds = 0, dt_s, _holds(hands.holds)
            self._present, self._place_m, self._turn_rad = _pose(hands)
            self._saved.save()
        self._ticks += 1

    def forget(self) -> None:
        """Let the next tick be tried: something that is no state has changed."""
        self._ticks = 0

    def _hands_rest(self, hands: ToolInputs) -> bool:
        present, place_m, turn_rad = _pose(hands)
        moved_m, turned_rad = np.abs(place_m - self._place_m), np.abs(turn_rad - self._turn_rad)
        return bool(
            np.array_equal(present, self._present)
            and (moved_m <= self._least_m).all()
            and (turned_rad <= self._least_rad).all()
            and _holds(hands.holds) == self._holds
        )


def _pose(hands: ToolInputs) -> tuple[AnyArray, FloatArray, FloatArray]:
    """Return which tools are present, their positions (2, 3), and their angles (2, 2)."""
    return hands.present.copy(), hands.position_m.copy(), np.stack([hands.roll_rad, hands.jaw_angle_rad])


def _holds(holds: Iterable[GraspHold] | None) -> tuple[Any, ...]:
    """Return what tells these holds from others."""
    if holds is None:
        return ()
    return tuple((hold.hold_id, hold.tool, hold.limit_n) for hold in holds)
