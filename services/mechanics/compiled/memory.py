"""Copies many arrays in one kernel call; a single copy from Python costs as much as copying ten kilobytes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from trocar.services.mechanics.arrays import AnyArray, LongArray
from trocar.services.mechanics.compiled import kernel


def copy_table(targets: Sequence[AnyArray], sources: Sequence[AnyArray]) -> LongArray:
    """Return the table (k, 3) for `copy_arrays`: target address, source address and number of bytes of each pair.

    The table does not keep the arrays alive: its owner must keep them, and never replace one.
    Raises ValueError if two arrays differ in dtype or shape, or one is not contiguous.
    """
    table = np.zeros((len(targets), 3), np.int64)
    for row, (target, source) in enumerate(zip(targets, sources, strict=True)):
        if target.dtype != source.dtype or target.shape != source.shape:
            raise ValueError(f"{source.dtype} {source.shape} is not copied to {target.dtype} {target.shape}")
        if not (target.flags.c_contiguous and source.flags.c_contiguous):
            raise ValueError("only contiguous arrays are copied")
        table[row] = target.ctypes.data, source.ctypes.data, source.nbytes
    return table


@kernel
def copy_arrays(table: LongArray) -> None:
    """Copy the bytes listed in a `copy_table` (k, 3)."""
    for row in range(table.shape[0]):
        _copy_bytes(table[row, 0], table[row, 1], table[row, 2])


class SavedArrays:
    """Copies of live arrays, contiguous and only changed in place, as they were at the last `save`."""

    def __init__(self, live: Sequence[AnyArray]) -> None:
        self._live, self._copies = live, [array.copy() for array in live]
        self._save, self._restore = copy_table(self._copies, live), copy_table(live, self._copies)

    def saved(self, live: AnyArray) -> AnyArray:
        """Return the copy of one of the live arrays. Raises KeyError if it is none of them."""
        for array, copy in zip(self._live, self._copies, strict=True):
            if array is live:
                return copy
        raise KeyError("the array is not among the saved ones")

    def save(self) -> None:
        """Copy the live arrays."""
        copy_arrays(self._save)

    def restore(self) -> None:
        """Overwrite the live arrays with their copies."""
        copy_arrays(self._restore)

    def are_as_saved(self) -> bool:
        """Return whether all live arrays are, number by number, as they were at the last `save`."""
        return all(map(np.array_equal, self._live, self._copies))


class SavedRows:
    """Copies of the first rows of live arrays, contiguous and only changed in place.

    Args:
        live: Sequence of arrays with the same number of rows.

    Attributes:
        count: int. Rows of each array that were saved last.
    """

    def __init__(self, live: Sequence[AnyArray]) -> None:
        self._live, self._copies, self.count = live, [array.copy() for array in live], 0
        n_rows = len(live[0])
        self._save, self._restore = copy_table(self._copies, live), copy_table(live, self._copies)
        for table in (self._save, self._restore):
            table[:, 2] //= n_rows

    def save(self, count: int) -> None:
        """Copy the first ``count`` rows."""
        self.count = count
        copy_rows_of_arrays(self._save, count)

    def restore(self) -> None:
        """Overwrite the live arrays' first rows with their copies."""
        copy_rows_of_arrays(self._restore, self.count)


@kernel
def copy_rows_of_arrays(table: LongArray, count: int) -> None:
    """Copy the first ``count`` rows of arrays, whose bytes a row are those listed in a `copy_table` (k, 3)."""
    for row in range(table.shape[0]):
        _copy_bytes(table[row, 0], table[row, 1], count * table[row, 2])


PAGE_WORDS = 512
"""Numbers of 8 bytes in the smallest page of Linux, 4 KiB: larger ones are then touched several times."""


class SavedPages:
    """A copy of a large live array that is mostly zero: only of its pages that hold anything else.

    Memory that was never written to takes none, and neither saving nor restoring writes to it.

    Args:
        live: Array. Contiguous, of a multiple of 8 bytes, and only changed in place.

    Raises ValueError if the array is not contiguous.
    """

    def __init__(self, live: AnyArray) -> None:
        if not live.flags.c_contiguous:
            raise ValueError("only contiguous arrays are copied")
        self._words = live.reshape(-1).view(np.int64)
        self._pages = np.array(
            [at for at in range(0, self._words.size, PAGE_WORDS) if self._words[at : at + PAGE_WORDS].any()], np.int64
        )
        kept = [self._words[at : at + PAGE_WORDS] for at in self._pages]
        self._content = np.concatenate([np.zeros(0, np.int64), *kept])

    @property
    def nbytes(self) -> int:
        """Bytes that the copy takes."""
        return self._content.nbytes + self._pages.nbytes

    def restore(self) -> None:
        """Overwrite the live array with its copy."""
        restore_pages(self._words, self._pages, self._content)


@kernel
def restore_pages(words: LongArray, pages: LongArray, content: LongArray) -> None:
    """Write the ``content`` of the pages that begin at ``pages``, ascending, and zeros where the others hold any."""
    page, first = 0, 0
    for at in range(0, words.shape[0], PAGE_WORDS):
        end = min(at + PAGE_WORDS, words.shape[0])
        if page < pages.shape[0] and pages[page] == at:
            for k in range(at, end):
                words[k] = content[first + k - at]
            page, first = page + 1, first + end - at
        else:
            clear_words(words, at, end)


@kernel
def clear_words(words: LongArray, first: int, end: int) -> None:
    """Write zeros from ``first`` to ``end`` if any word there is not zero; a page that is only read takes no memory."""
    found = 0
    for k in range(first, end):
        found |= words[k]
    if found != 0:
        for k in range(first, end):
            words[k] = 0


@intrinsic
def _copy_bytes(_context: Any, target: Any, source: Any, count: Any) -> Any:
    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        byte = ir.IntType(8).as_pointer()
        to, of = builder.inttoptr(arguments[0], byte), builder.inttoptr(arguments[1], byte)
        copy = builder.module.declare_intrinsic("llvm.memcpy", [byte, byte, arguments[2].type])
        builder.call(copy, [to, of, arguments[2], ir.Constant(ir.IntType(1), 0)])
        return ir.Constant(ir.IntType(1), 1)

    return types.boolean(target, source, count), generate
