"""Checks of a step's arguments before anything moves, because kernels do not check theirs.

Impossible numbers of a tool are a fault of a device, not of the caller: `bodies.forceps.ToolBody` then keeps the tool
where it was.
"""

from __future__ import annotations

from collections.abc import Sequence
from operator import attrgetter, is_

import numpy as np

from trocar.services.mechanics.scene.tools import N_TOOLS, GraspHold, ToolInputs

_ARRAYS: dict[str, tuple[tuple[int, ...], type[np.generic]]] = {
    "present": ((N_TOOLS,), np.bool_),
    "position_m": ((N_TOOLS, 3), np.float64),
    "roll_rad": ((N_TOOLS,), np.float64),
    "jaw_angle_rad": ((N_TOOLS,), np.float64),
}
_INTEGERS, _FLOATS = ("hold_id", "tool", "target_kind", "target"), ("limit_n", "jaw_angle_rad")
_numbers, _usual = attrgetter(*_INTEGERS, *_FLOATS), [int] * len(_INTEGERS) + [float] * len(_FLOATS)


class ArgumentChecks:
    """Checks the tools and their holds in each call; arrays only if they are others than in the last call."""

    def __init__(self) -> None:
        self._checked: tuple[object, ...] = (None,) * len(_ARRAYS)

    def check(self, tools: ToolInputs) -> None:
        """Raise TypeError: something is of another type. Raise ValueError: an array is of another shape or dtype."""
        if not isinstance(tools, ToolInputs):
            raise TypeError(f"tools must be ToolInputs, is {_kind(tools)}")
        arrays = tools.present, tools.position_m, tools.roll_rad, tools.jaw_angle_rad
        if not all(map(is_, arrays, self._checked)):
            for (name, (shape, dtype)), array in zip(_ARRAYS.items(), arrays, strict=True):
                _check_array(f"tools.{name}", array, shape, dtype)
            self._checked = arrays
        if tools.holds is not None:
            _check_holds(tools.holds)


def _check_array(place: str, array: object, shape: tuple[int, ...], dtype: type[np.generic]) -> None:
    if not isinstance(array, np.ndarray):
        raise TypeError(f"{place} must be an array {shape} of {dtype.__name__}, is {_kind(array)}")
    if array.shape != shape or array.dtype != dtype:
        raise ValueError(f"{place} must be an array {shape} of {dtype.__name__}, is {array.shape} of {array.dtype}")
    if not array.flags.c_contiguous:
        raise ValueError(f"{place} must lie in C order without gaps")


def _check_holds(holds: Sequence[GraspHold]) -> None:
    if not isinstance(holds, list | tuple):
        raise TypeError(f"tools.holds must be a list of GraspHold or None, is {_kind(holds)}")
    for index, hold in enumerate(holds):
        place = f"tools.holds[{index}]"
        if not isinstance(hold, GraspHold):
            raise TypeError(f"{place} must be a GraspHold, is {_kind(hold)}")
        if list(map(type, _numbers(hold))) != _usual:
            _check_numbers(hold, place)
        weights = hold.target_weights
        if not isinstance(weights, np.ndarray) or weights.shape != (3,) or weights.dtype != np.float64:
            raise ValueError(f"{place}.target_weights must be an array (3,) of float64")


def _check_numbers(hold: GraspHold, place: str) -> None:
    for name in _INTEGERS:
        if not isinstance(value := getattr(hold, name), int | np.integer):
            raise TypeError(f"{place}.{name} must be a whole number, is {value!r}")
    for name in _FLOATS:
        if not isinstance(value := getattr(hold, name), float | int | np.number):
            raise TypeError(f"{place}.{name} must be a number, is {value!r}")


def _kind(value: object) -> str:
    return type(value).__name__
