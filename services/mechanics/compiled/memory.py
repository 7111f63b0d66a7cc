"""Copies of many arrays in one kernel call: from Python each would cost as much as ten kilobytes of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from services.mechanics.arrays import AnyArray, LongArray
from services.mechanics.compiled import kernel


def copy_table(targets: Sequence[AnyArray], sources: Sequence[AnyArray]) -> LongArray:
    """Return (k, 3) of `copy_arrays`: where the bytes of each pair of arrays lie, and how many there are.

    Nothing keeps the arrays alive, nor where they are: whoever keeps the table keeps them, and never replaces one.
    Raises ValueError if two arrays are of different kinds or shapes, or one is not contiguous.
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
    """Copy the bytes that a `copy_table` (k, 3) names."""
    for row in range(table.shape[0]):
        _copy_bytes(table[row, 0], table[row, 1], table[row, 2])


@intrinsic
def _copy_bytes(_context: Any, target: Any, source: Any, count: Any) -> Any:
    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        byte = ir.IntType(8).as_pointer()
        to, of = builder.inttoptr(arguments[0], byte), builder.inttoptr(arguments[1], byte)
        copy = builder.module.declare_intrinsic("llvm.memcpy", [byte, byte, arguments[2].type])
        builder.call(copy, [to, of, arguments[2], ir.Constant(ir.IntType(1), 0)])
        return ir.Constant(ir.IntType(1), 1)

    return types.boolean(target, source, count), generate
