"""Kernels that kernels call are compiled for plain numbers: not anew for each size of an integer and each constant.

To numba an ``int8`` out of an array, the ``int64`` of a loop and the constant 3 are three types, and a kernel that is
called with each of them is three kernels, with all that they call: one compilation in six. What is called is compiled
for the int64, and its callers convert. A constant is still known where a kernel is inlined.
"""

from __future__ import annotations

from typing import Any

from numba import types


def plain(kind: Any) -> Any:
    """Return the type that stands for an argument's: int64 for each integer that it holds, tuples part by part."""
    if isinstance(kind, types.IntegerLiteral | types.BooleanLiteral):
        return plain(kind.literal_type)
    if isinstance(kind, types.Integer) and kind.bitwidth < types.int64.bitwidth:
        return types.int64
    if isinstance(kind, types.Tuple | types.UniTuple):
        return types.Tuple([plain(each) for each in kind.types])
    return kind
