"""Copies of the state of a world, to go back to."""

from __future__ import annotations

from collections.abc import Sequence

from services.mechanics.arrays import AnyArray
from services.mechanics.compiled.memory import copy_arrays, copy_table

# Copies that are kept, beside the first: the last one, that before, and others about 4, 8, 16... as old.
PLACES = 8
_NEVER = -1
FIRST = -1
"""The place of the first copy of all."""


class Copies:
    """Copies of live arrays, which must be changed in place and never replaced: of late ones many, of old ones few.

    The k-th copy is written over place z, 2^z being the largest power of two that k is a multiple of. So place z holds
    what is at most 2^(z + 1) copies old. The first copy of all is kept beside them.
    """

    def __init__(self, arrays: Sequence[AnyArray]) -> None:
        self._arrays = list(arrays)
        self._kept = [[array.copy() for array in self._arrays] for _ in range(PLACES)]
        self._first = [array.copy() for array in self._arrays]
        self._from_live = [copy_table(kept, self._arrays) for kept in self._kept]
        self._to_live = [copy_table(self._arrays, kept) for kept in [*self._kept, self._first]]
        self._order = [_NEVER] * PLACES
        self._count = 0
        self._is_trusted = False

    @property
    def are_all_trusted(self) -> bool:
        """Whether one was taken up, and none has been kept since."""
        return self._is_trusted

    def keep(self) -> None:
        """Copy what is there; it may already be on its way to what is not sound."""
        self._count += 1
        place = min((self._count & -self._count).bit_length() - 1, PLACES - 1)  # never the last one's
        copy_arrays(self._from_live[place])
        self._order[place] = self._count
        self._is_trusted = False

    def places(self) -> list[int]:
        """Return where copies are that may be taken up: from the last but one to the first of all."""
        kept = [place for place in range(PLACES) if self._order[place] != _NEVER]
        kept.sort(key=self._order.__getitem__, reverse=True)
        return [*kept[0 if self._is_trusted else 1 :], FIRST]

    def put_back(self, place: int) -> None:
        """Write a copy over what is there."""
        copy_arrays(self._to_live[place])

    def go_on_before(self, place: int) -> None:
        """Forget this copy, which was taken up, and all that are newer: what comes of it may not be sound again."""
        began = 1 if place == FIRST else self._order[place]
        self._order = [kept if kept < began else _NEVER for kept in self._order]
        self._count, self._is_trusted = began - 1, True
