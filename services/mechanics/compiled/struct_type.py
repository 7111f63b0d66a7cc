"""Structs as numba's compiler sees them: a pointer whose attributes are typed by the layout.

Only what numba documents for extensions is used: a type with a data model, attributes by `lower_getattr_generic` and
`lower_setattr_generic`, and a struct proxy to make an array of its address and extents. Such an array owns nothing.

Addresses and extents do not change while a kernel runs, and the compiler is told so (``invariant.load``): otherwise it
would load them again after every store to an array.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import from_dtype, types
from numba.core.typing.templates import AttributeTemplate
from numba.extending import infer_getattr, lower_getattr_generic, lower_setattr_generic, models, register_model
from numpy import dtype

from services.mechanics.compiled.aggregate import new_array, product
from services.mechanics.compiled.layout import ArrayField, Field, Layout, ScalarField, StructField

_INT = ir.IntType(64)
_SCALARS = {"float": types.float64, "int": types.int64, "bool": types.boolean}


class StructType(types.Type):  # type: ignore[misc]  # numba has no types
    """Pointer to a struct of one layout; two classes of the same name and layout are one type."""

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
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


@infer_getattr
class _Attributes(AttributeTemplate):  # type: ignore[misc]
    key = StructType

    def generic_resolve(self, kind: StructType, name: str) -> types.Type | None:
        field = dict(kind.layout.fields).get(name)
        return None if field is None else kind.type_of(field)


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
    """Emit the load of a word of a struct; a constant one stays as it is while a kernel runs.

    Addresses are loaded as pointers: of one that is made from an integer the optimiser knows nothing.
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
    strides = [product(builder, [*shape[axis + 1 :][::-1], item]) for axis in range(len(shape))]
    pointer = context.get_data_type(array_type.dtype).as_pointer()
    data = load_word(builder, struct, field.word, pointer, is_constant=True)
    return new_array(context, builder, array_type, data, shape, strides, itemsize=item)
