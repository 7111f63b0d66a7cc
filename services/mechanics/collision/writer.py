"""Writing contact pairs into the solver's arrays; when they are full the deepest are kept."""

from __future__ import annotations

import numpy as np

from services.mechanics.collision.pairs import ContactPairs
from services.mechanics.collision.primitives import put
from services.mechanics.compiled import Struct, fill, flags, floats, ints, kernel, struct_reader, struct_type
from services.mechanics.compiled.vectors import Vector, dot

FULL = -1

Rows = Struct
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
ROWS = struct_type(arrays=_ARRAYS, counts=("used", "dropped", "capacity"))
rows_at = struct_reader(ROWS)

Pair = tuple[int, int, int, int, int, float, Vector]
"""(tool, tool segment, particle, kind of target, target, place on the first body, weights in the target)."""


class PairWriter:
    """Kernel view of the pairs that a detector fills; made anew only when another set is handed in."""

    def __init__(self) -> None:
        self._storage = np.zeros(1, ROWS)
        self._rows: Rows = self._storage[0]
        self._counts = self._storage.view(np.int64)[-3:]  # used, dropped, capacity
        self._address: int = self._storage.ctypes.data
        self._pairs = ContactPairs.allocate(0)

    def open(self, pairs: ContactPairs) -> int:
        """Return the address of the rows of ``pairs``, appending after those already there."""
        if self._pairs is not pairs:
            fill(self._rows, capacity=pairs.capacity, **{name: getattr(pairs, name) for name in _ARRAYS})
            self._pairs = pairs
        self._counts[0], self._counts[1] = pairs.count, pairs.dropped
        return self._address

    def close(self) -> None:
        """Tell the pairs how many rows are used now."""
        self._pairs.count, self._pairs.dropped = int(self._counts[0]), int(self._counts[1])


@kernel
def is_due(gap_m: float, normal: Vector, motion: Vector, margin_m: float) -> bool:
    """Return whether a gap is within the margin, or will be in a tick if the motion of the last one goes on."""
    return gap_m + min(dot(normal, motion), 0.0) < margin_m


@kernel
def write_pair(rows: Rows, pair: Pair, gap_m: float, normal: Vector) -> None:
    """Write one pair; where there is no room it replaces the shallowest, if that is shallower."""
    row = _free_row(rows, gap_m)
    if row == FULL:
        return
    flags(rows.tool)[row] = pair[0]
    flags(rows.tool_segment)[row] = pair[1]
    ints(rows.particle)[row] = pair[2]
    flags(rows.target_kind)[row] = pair[3]
    ints(rows.target)[row] = pair[4]
    floats(rows.tool_parameter)[row] = pair[5]
    put(floats(rows.target_weights), row, pair[6])
    put(floats(rows.normal), row, normal)
    floats(rows.gap_m)[row] = gap_m


@kernel
def _free_row(rows: Rows, gap_m: float) -> int:
    if rows.used < rows.capacity:
        rows.used += 1
        return int(rows.used - 1)
    rows.dropped += 1
    gaps, shallowest = floats(rows.gap_m), FULL
    for k in range(rows.capacity):
        if gaps[k] > gap_m and (shallowest == FULL or gaps[k] > gaps[shallowest]):
            shallowest = k
    return shallowest
