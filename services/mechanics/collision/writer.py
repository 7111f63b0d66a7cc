"""Writing contact pairs into the solver's arrays; when they are full the deepest are kept."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from services.mechanics.collision.kernel import kernel
from services.mechanics.collision.primitives import Vector
from services.mechanics.contact.pairs import ContactPairs
from services.mechanics.mesh import FloatArray, IntArray

FULL = -1
_ARRAYS = (
    "tool",
    "tool_segment",
    "particle",
    "target_kind",
    "target",
    "tool_parameter",
    "target_weights",
    "normal",
    "gap_m",
)


class PairRows(NamedTuple):
    """The arrays of `ContactPairs`, and how many rows are used and dropped."""

    tool: npt.NDArray[np.int8]
    tool_segment: npt.NDArray[np.int8]
    particle: IntArray
    target_kind: npt.NDArray[np.int8]
    target: IntArray
    tool_parameter: FloatArray
    target_weights: FloatArray
    normal: FloatArray
    gap_m: FloatArray
    used: npt.NDArray[np.int64]
    """(2,) rows in use, rows dropped."""


class PairWriter:
    """Kernel view of the pairs that a detector fills; made anew only when another set is handed in."""

    def __init__(self) -> None:
        self._pairs: ContactPairs | None = None
        self._rows: PairRows | None = None

    def open(self, pairs: ContactPairs) -> PairRows:
        """Return the rows of ``pairs``, appending after those already there."""
        if self._rows is None or self._pairs is not pairs:
            arrays = (getattr(pairs, name) for name in _ARRAYS)
            self._rows, self._pairs = PairRows(*arrays, np.zeros(2, np.int64)), pairs
        self._rows.used[0], self._rows.used[1] = pairs.count, pairs.dropped
        return self._rows

    def close(self) -> None:
        """Tell the pairs how many rows are used now."""
        if self._rows is not None and self._pairs is not None:
            self._pairs.count, self._pairs.dropped = int(self._rows.used[0]), int(self._rows.used[1])


@kernel
def take_row(rows: PairRows, gap_m: float, normal: Vector) -> int:
    """Return the row for a pair with this gap, normal and gap filled in; `FULL` if all others are deeper."""
    row = rows.used[0]
    if row < rows.gap_m.shape[0]:
        rows.used[0] += 1
    else:
        rows.used[1] += 1
        row = 0
        for k in range(1, rows.gap_m.shape[0]):
            if rows.gap_m[k] > rows.gap_m[row]:
                row = k
        if rows.gap_m.shape[0] == 0 or rows.gap_m[row] <= gap_m:
            return FULL
    rows.gap_m[row] = gap_m
    for axis in range(3):
        rows.normal[row, axis] = normal[axis]
    return int(row)
