"""Items of arrays in half of the instructions that numba makes for ``a[i, j]``: a start without a cache waits for them.

Code for items of contiguous arrays is registered with numba. Slices, rows and unsigned indices are numba's own, as is
everything where bounds are checked.
"""

from __future__ import annotations

import itertools
import operator
import os
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import lower_builtin

_INT = ir.IntType(64)
_DTYPES = types.float64, types.float32, types.int64, types.int32, types.boolean
_MOST_AXES = 4


def register() -> None:
    """Register the code, once in a process."""
    if os.environ.get("NUMBA_BOUNDSCHECK", "0") != "0":
        return
    for item, n, readonly in itertools.product(_DTYPES, range(1, _MOST_AXES + 1), (False, True)):
        array, index = types.Array(item, n, "C", readonly), types.UniTuple(types.intp, n) if n > 1 else types.intp
        lower_builtin(operator.getitem, array, index)(_get)
        if not readonly:
            lower_builtin(operator.setitem, array, index, types.Any)(_set)


def _get(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    array = signature.args[0]
    return context.unpack_value(builder, array.dtype, _place(context, builder, array, *arguments))


def _set(context: Any, builder: Any, signature: Any, arguments: Any) -> None:
    array, _, given = signature.args
    value = context.cast(builder, arguments[2], given, array.dtype)
    context.pack_value(builder, array.dtype, value, _place(context, builder, array, *arguments[:2]))


def _place(context: Any, builder: Any, array: types.Array, value: Any, index: Any) -> Any:
    """Return the address of an item; a negative index counts from the end."""
    model, place = context.data_model_manager[array], _INT(0)
    for axis in range(array.ndim):
        at = _entry(builder, index, axis) if array.ndim > 1 else index
        extent = builder.extract_value(value, [model.get_field_position("shape"), axis])
        if not (isinstance(at, ir.Constant) and at.constant >= 0):
            at = builder.select(builder.icmp_signed("<", at, _INT(0)), builder.add(at, extent), at)
        place = builder.add(builder.mul(place, extent), at) if axis else at
    return builder.gep(builder.extract_value(value, model.get_field_position("data")), [place])


def _entry(builder: Any, made: Any, axis: int) -> Any:
    """Return an entry of a tuple, as it was put in where that is seen: it may be a constant."""
    while isinstance(made, ir.instructions.InsertValue):
        if list(made.indices) == [axis]:
            return made.operands[1]
        made = made.operands[0]
    return builder.extract_value(made, axis)
