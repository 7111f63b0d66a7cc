"""A ring of recent states that is written to a file when a value becomes NaN or infinite."""

from __future__ import annotations

import math
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from trocar.services.files.cache_directory import make_folders
from trocar.services.runtime.loop.flat_view import flat_view


class NanGuard:
    """Checks named arrays, and keeps their last `depth` values to show the steps before a NaN.

    Args:
        arrays: The live arrays by name. They must be changed in place, never replaced.
        directory: Directory of dumps ``nan-<name>-<monotonic ns>.npz``: one array (depth, ...) per name, oldest first.
        depth: Number of ticks in the dump.
    """

    def __init__(self, name: str, arrays: dict[str, NDArray[np.float64]], directory: Path, depth: int = 100) -> None:
        self._name = name
        self._directory = directory
        self._kept = np.zeros((depth, sum(value.size for value in arrays.values())))
        self._ring, first = {}, 0
        for key, value in arrays.items():
            self._ring[key] = self._kept[:, first : first + value.size].reshape(depth, *value.shape)
            first += value.size
        self._depth = depth
        self._next = 0
        self._live = [flat_view(value) for value in arrays.values()]
        self._of_tick = list(self._kept)
        self._rows = [[flat_view(ring[row]) for ring in self._ring.values()] for row in range(depth)]
        self.dumps: list[Path] = []

    def watch(self) -> bool:
        """Store the present values; if one is NaN or infinite, write the dump and return False."""
        row = self._next % self._depth
        self._next += 1
        for kept, value in zip(self._rows[row], self._live, strict=True):
            kept[:] = value
        # A norm is finite only if every number is; it is much cheaper than a mask, and an overflow is as bad as a NaN.
        numbers = self._of_tick[row]
        finite = math.isfinite(np.vdot(numbers, numbers))
        if not finite:
            self._dump()
        return finite

    def _dump(self) -> None:
        make_folders(self._directory)
        path = self._directory / f"nan-{self._name}-{time.monotonic_ns()}.npz"
        kept = min(self._next, self._depth)
        order = (np.arange(kept) + self._next - kept) % self._depth
        np.savez(path, **{key: ring[order] for key, ring in self._ring.items()})  # type: ignore[arg-type]
        self.dumps.append(path)
