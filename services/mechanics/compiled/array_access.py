"""Items and rows of arrays in as few instructions as they need: numba writes fifty for ``a[i, j]``.

Such accesses are half of what numba writes for our kernels, and each instruction is made as an object of Python,
printed, parsed and simplified, until a dozen are left. Lowered here are arrays in C's order with an integer for each
axis, or for the first axes; anything else, and all where bounds are checked, is numba's own.
"""

from __future__ import annotations

import operator
from collections.abc import Sequence
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.imputils import impl_ret_borrowed
from numba.extending import lower_builtin
from numba.np.arrayobj import getitem_array_tuple, getitem_arraynd_intp, load_item, setitem_array, store_item

from services.mechanics.compiled.aggregate import Aggregate, new_array, product

_INT = ir.IntType(64)


def begin() -> None:
    """Lower accesses so in this process; once."""
    for index in (types.Integer, types.BaseTuple):
        lower_builtin(operator.getitem, types.Array, index)(_get)
        lower_builtin(operator.setitem, types.Array, index, types.Any)(_set)


def _get(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    kind, index = signature.args
    result, kinds = signature.return_type, _kinds(index)
    rest = range(len(kinds), kind.ndim)
    if not _is_plain(context, kind, kinds) or (rest and result.layout != "C"):
        numbas = getitem_array_tuple if isinstance(index, types.BaseTuple) else getitem_arraynd_intp
        return numbas(context, builder, signature, arguments)
    array = Aggregate(context, builder, kind, arguments[0])
    place = _place(context, builder, kind, array, index, arguments[1])
    if not rest:
        return load_item(context, builder, kind, place)
    shape, strides = [[array.part(name, axis) for axis in rest] for name in ("shape", "strides")]
    shared = {name: array.part(name) for name in ("itemsize", "meminfo", "parent")}
    row = new_array(context, builder, result, place, shape, strides, **shared)
    return impl_ret_borrowed(context, builder, result, row)


def _set(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    kind, index, given = signature.args
    kinds = _kinds(index)
    if not _is_plain(context, kind, kinds) or len(kinds) < kind.ndim:
        return setitem_array(context, builder, signature, arguments)
    array = Aggregate(context, builder, kind, arguments[0])
    place = _place(context, builder, kind, array, index, arguments[1])
    store_item(context, builder, kind, context.cast(builder, arguments[2], given, kind.dtype), place)
    return None


def _kinds(index: Any) -> Sequence[Any]:
    kinds: Sequence[Any] = index.types if isinstance(index, types.BaseTuple) else (index,)
    return kinds


def _is_plain(context: Any, kind: Any, kinds: Sequence[Any]) -> bool:
    return (
        type(kind) is types.Array
        and kind.layout == "C"
        and not context.enable_boundscheck
        and 0 < len(kinds) <= kind.ndim
        and all(isinstance(each, types.Integer) for each in kinds)
    )


def _place(context: Any, builder: Any, kind: Any, array: Aggregate, index_kind: Any, index: Any) -> Any:
    """Return the address of an item, or of the first of a row; a negative index counts from the end."""
    kinds = _kinds(index_kind)
    is_tuple = isinstance(index_kind, types.BaseTuple)
    indices = cgutils.unpack_tuple(builder, index, count=len(kinds)) if is_tuple else [index]
    extents = [None, *(array.part("shape", axis) for axis in range(1, kind.ndim))]
    place = None
    for axis, (each, value) in enumerate(zip(kinds, indices, strict=True)):
        at = context.cast(builder, value, each, types.intp if each.signed else types.uintp)
        if each.signed and not _is_from_the_start(at):
            extent = extents[axis] if axis else array.part("shape", 0)
            at = builder.select(builder.icmp_signed("<", at, _INT(0)), builder.add(at, extent), at)
        if axis + 1 < kind.ndim:
            at = builder.mul(at, product(builder, extents[axis + 1 :]))
        place = at if place is None else builder.add(place, at)
    return builder.gep(array.part("data"), [place])


def _is_from_the_start(index: Any) -> bool:
    return isinstance(index, ir.Constant) and isinstance(index.constant, int) and index.constant >= 0
