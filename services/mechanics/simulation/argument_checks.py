"""Checks of a step's arguments before anything moves, because kernels do not check theirs.

Arrays of tools are checked only when they are new, because callers change them in place; holds are checked in every
call. Impossible numbers of a tool are a fault of a device, not of the caller: `bodies.forceps.ToolBody` then keeps the
tool where it was.
"""

from __future__ import annotations

from operator import attrgetter

import numpy as np

from services.mechanics.arrays import AnyArray
from services.mechanics.scene.tools import N_TOOLS, GraspHold, ToolInputs

SHAPES: dict[str, tuple[tuple[int, ...], type[np.generic]]] = {
    "present": ((N_TOOLS,), np.bool_),
    "position_m": ((N_TOOLS, 3), np.float64),
    "roll_rad": ((N_TOOLS,), np.float64),
    "jaw_angle_rad": ((N_TOOLS,), np.float64),
}
_INTEGERS = "hold_id", "tool", "target_kind", "target"
_FLOATS = "limit_n", "jaw_angle_rad"
_numbers_of = attrgetter(*_INTEGERS, *_FLOATS)
_EXPECTED_TYPES = (int,) * len(_INTEGERS) + (float,) * len(_FLOATS)


class ArgumentCheck:
    """Rejects calls of `Simulation.step` with arguments of the wrong type, shape or dtype."""

    def __init__(self) -> None:
        self._seen: tuple[AnyArray | None, ...] = (None,) * len(SHAPES)

    def check(self, tools: ToolInputs) -> None:
        """Check the tools and their holds.

        Raises TypeError: something is of another type. Raises ValueError: an array is of another shape or dtype.
        """
        present, position, roll, opening = self._seen
        try:
            known = tools.position_m is position and tools.present is present
            known = known and tools.roll_rad is roll and tools.jaw_angle_rad is opening
        except AttributeError:
            raise TypeError(f"tools must be ToolInputs, is {_kind(tools)}") from None
        if not known:
            self._check_arrays(tools)
        if tools.holds is not None:
            check_holds(tools.holds)

    def _check_arrays(self, tools: ToolInputs) -> None:
        for name, (shape, dtype) in SHAPES.items():
            array = getattr(tools, name)
            if not isinstance(array, np.ndarray):
                raise TypeError(f"tools.{name} must be an array {shape} of {dtype.__name__}, is {_kind(array)}")
            if array.shape != shape or array.dtype != dtype:
                actual = f"{array.shape} of {array.dtype}"
                raise ValueError(f"tools.{name} must be an array {shape} of {dtype.__name__}, is {actual}")
            if not array.flags.c_contiguous:
                raise ValueError(f"tools.{name} must lie in C order without gaps")
        self._seen = tuple(getattr(tools, name) for name in SHAPES)


def check_holds(holds: list[GraspHold]) -> None:
    """Raise TypeError or ValueError where something in a list of holds has the wrong type, shape or dtype."""
    if not isinstance(holds, list | tuple):
        raise TypeError(f"tools.holds must be a list of GraspHold or None, is {_kind(holds)}")
    for index, hold in enumerate(holds):
        if type(hold) is not GraspHold or tuple(map(type, _numbers_of(hold))) != _EXPECTED_TYPES:  # nearly none
            _check_hold(hold, f"tools.holds[{index}]")
        weights = hold.target_weights
        if not isinstance(weights, np.ndarray) or weights.shape != (3,) or weights.dtype != np.float64:
            raise ValueError(f"tools.holds[{index}].target_weights must be an array (3,) of float64")


def _check_hold(hold: GraspHold, place: str) -> None:
    if not isinstance(hold, GraspHold):
        raise TypeError(f"{place} must be a GraspHold, is {_kind(hold)}")
    for name in _INTEGERS:
        if not isinstance(getattr(hold, name), int | np.integer):
            raise TypeError(f"{place}.{name} must be a whole number, is {getattr(hold, name)!r}")
    for name in _FLOATS:
        if not isinstance(getattr(hold, name), float | int | np.number):
            raise TypeError(f"{place}.{name} must be a number, is {getattr(hold, name)!r}")


def _kind(value: object) -> str:
    return type(value).__name__
