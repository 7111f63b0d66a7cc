"""Copies of the state of a world, to go back to."""

from __future__ import annotations

from collections.abc import Sequence

from services.mechanics.arrays import AnyArray
from services.mechanics.compiled.memory import copy_arrays, copy_table


class Copies:
    """Copies of live arrays, which must be changed in place and never replaced: the last two and the first."""

    def __init__(self, arrays: Sequence[AnyArray]) -> None:
        self._arrays = list(arrays)
        self._kept = [[array.copy() for array in self._arrays] for _ in range(2)]
        self._first = [array.copy() for array in self._arrays]
        self._from_live = [copy_table(kept, self._arrays) for kept in self._kept]
        self._to_live = [copy_table(self._arrays, kept) for kept in self._kept]
        self._first_to_live = copy_table(self._arrays, self._first)
        self._newest = 0

    def keep(self) -> None:
        """Copy what is there over the older copy."""
        self._newest = 1 - self._newest
        copy_arrays(self._from_live[self._newest])

    def restore(self, from_the_beginning: bool) -> None:
        """Put the older copy back, or the first one of all, and forget the newer one, or both."""
        copy_arrays(self._first_to_live if from_the_beginning else self._to_live[1 - self._newest])
        copy_arrays(self._from_live[self._newest])
        if from_the_beginning:
            copy_arrays(self._from_live[1 - self._newest])
