"""numba's type of a struct: a pointer whose attributes are typed by the layout.

Only documented interfaces of numba are used: a type with a data model, the types of attributes by
`structref.define_attributes`, their code by `lower_getattr_generic` and `lower_setattr_generic`. An array built from
address and extents does not own its memory.

Addresses and extents do not change while a kernel runs. The loads are marked ``invariant.load``; otherwise the compiler
would repeat them after every store to an array.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from llvmlite import ir
from numba import from_dtype, types
from numba.experimental import structref
from numba.extending import lower_getattr_generic, lower_setattr_generic, models, register_model
from numpy import dtype

from trocar.services.mechanics.compiled.layout import ArrayField, Field, Layout, ScalarField, StructField

_INT = ir.IntType(64)
_SCALARS = {"float": types.float64, "int": types.int64, "bool": types.boolean}


class _HasFields(types.Type):  # type: ignore[misc]  # numba has no types
    """Base with ``field_dict``, from which numba takes the types of attributes."""


structref.define_attributes(_HasFields)


class StructType(_HasFields):
    """Pointer to a struct of one layout; two classes of the same name and layout are one type."""

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        self.field_dict = {name: self.type_of(field) for name, field in layout.fields}
        super().__init__(f"{layout.name}-{layout.digest}")

    def type_of(self, field: Field) -> types.Type:
        """Return the type of a field's value."""
        if isinstance(field, StructField):
            return StructType(field.layout)
        if isinstance(field, ScalarField):
            return _SCALARS[field.kind]
        return types.Array(from_dtype(dtype(field.dtype)), len(field.extents), "C")


@register_model(StructType)
class _StructModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: StructType) -> None:
        super().__init__(manager, kind, _INT.as_pointer())


@lower_getattr_generic(StructType)
def _get(context: Any, builder: Any, kind: StructType, struct: Any, name: str) -> Any:
    field = dict(kind.layout.fields)[name]
    if isinstance(field, ArrayField):
        return _array(context, builder, kind, struct, field)
    if isinstance(field, StructField):
        return load_word(builder, struct, field.word, context.get_value_type(kind.type_of(field)), is_constant=True)
    value = load_word(builder, struct, field.word)
    if field.kind == "float":
        return builder.bitcast(value, ir.DoubleType())
    return builder.icmp_signed("!=", value, _INT(0)) if field.kind == "bool" else value


@lower_setattr_generic(StructType)
def _set(context: Any, builder: Any, signature: Any, arguments: Any, name: str) -> None:
    kind, given = signature.args
    field = dict(kind.layout.fields)[name]
    if not isinstance(field, ScalarField):
        raise TypeError(f"{kind.layout.name}.{name}: kernels write into arrays and structs, they do not replace them")
    value = context.cast(builder, arguments[1], given, _SCALARS[field.kind])
    value = builder.bitcast(value, _INT) if field.kind == "float" else builder.zext(value, _INT)
    builder.store(value, builder.gep(arguments[0], [_INT(field.word)], inbounds=True))


def load_word(builder: Any, struct: Any, word: int, kind: Any = _INT, is_constant: bool = False) -> Any:
    """Emit the load of a word of a struct; a constant one does not change while a kernel runs.

    Addresses are loaded as pointers, because the optimiser has no information on pointers made from integers.
    """
    place = builder.gep(struct, [_INT(word)], inbounds=True)
    value = builder.load(builder.bitcast(place, kind.as_pointer()))
    if is_constant:
        value.set_metadata("invariant.load", builder.module.add_metadata([]))
    return value


def _array(context: Any, builder: Any, kind: StructType, struct: Any, field: ArrayField) -> Any:
    extents = dict(kind.layout.extents)
    shape = [
        load_word(builder, struct, extents[extent], is_constant=True) if isinstance(extent, str) else _INT(extent)
        for extent in field.extents
    ]
    array_type = kind.type_of(field)
    item = _INT(dtype(field.dtype).itemsize)
    strides = [_product(builder, [*shape[axis + 1 :][::-1], item]) for axis in range(len(shape))]
    pointer = context.get_data_type(array_type.dtype).as_pointer()
    model = context.data_model_manager[array_type]
    made = ir.Constant(model.get_value_type(), None)  # all zeros: nothing owns the memory

    def put(name: str, value: Any, *axis: int) -> None:
        nonlocal made
        made = builder.insert_value(made, value, [model.get_field_position(name), *axis])

    put("nitems", _product(builder, shape))
    put("itemsize", item)
    put("data", load_word(builder, struct, field.word, pointer, is_constant=True))
    for axis, (extent, stride) in enumerate(zip(shape, strides, strict=True)):
        put("shape", extent, axis)
        put("strides", stride, axis)
    return made


def _product(builder: Any, factors: Sequence[Any]) -> Any:
    """Return the product of integers; constant factors are multiplied at compile time."""
    known, made = 1, None
    for each in factors:
        if isinstance(each, ir.Constant):
            known *= each.constant
        else:
            made = each if made is None else builder.mul(made, each)
    if made is None:
        return _INT(known)
    return made if known == 1 else builder.mul(made, _INT(known))
