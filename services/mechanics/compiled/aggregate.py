"""Structs of the compiler, such as an array's, as values: taken apart and put together in place, without memory."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from llvmlite import ir

_INT = ir.IntType(64)


class Aggregate:
    """A value whose parts have names.

    numba keeps each in memory of its own, writes all parts and reads what it needs: thrice the instructions, which the
    optimiser takes out again, one by one.

    Parameters
    ----------
    kind
        numba's type.
    value
        None: one of zeros.
    """

    def __init__(self, context: Any, builder: Any, kind: Any, value: Any = None) -> None:
        self._builder = builder
        self._model = context.data_model_manager[kind]
        self.value = ir.Constant(self._model.get_value_type(), None) if value is None else value

    def part(self, name: str, *axis: int) -> Any:
        """Return a part; of one that has several the one of this number."""
        return self._builder.extract_value(self.value, [self._model.get_field_position(name), *axis])

    def put(self, name: str, value: Any, *axis: int) -> None:
        """Replace a part in `value`."""
        self.value = self._builder.insert_value(self.value, value, [self._model.get_field_position(name), *axis])


def new_array(
    context: Any, builder: Any, kind: Any, data: Any, shape: Sequence[Any], strides: Sequence[Any], **given: Any
) -> Any:
    """Return the value of an array of these parts; `given` are the size of an item, and whose the memory is."""
    made = Aggregate(context, builder, kind)
    for name, value in {"nitems": product(builder, shape), "data": data, **given}.items():
        made.put(name, value)
    for axis, (extent, stride) in enumerate(zip(shape, strides, strict=True)):
        made.put("shape", extent, axis)
        made.put("strides", stride, axis)
    return made.value


def product(builder: Any, factors: Sequence[Any]) -> Any:
    """Return the product of integers; what is known now is computed now."""
    known, made = 1, None
    for each in factors:
        if isinstance(each, ir.Constant):
            known *= each.constant
        else:
            made = each if made is None else builder.mul(made, each)
    if made is None:
        return _INT(known)
    return made if known == 1 else builder.mul(made, _INT(known))
