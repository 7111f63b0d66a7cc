"""Structs that Python fills and kernels read and write in place; docs/reference/kernels.md describes them.

A struct is a class with annotated fields. An object owns a few words of memory with its numbers and the addresses and
extents of its arrays, and keeps those arrays alive. Kernels receive its address.
"""

from __future__ import annotations

import ctypes
import numbers
import operator
from collections.abc import Callable
from typing import Any, ClassVar, Generic, NoReturn, Self, TypeVar, dataclass_transform

import numpy as np
from numba.extending import NativeValue, intrinsic, typeof_impl, unbox

from trocar.services.mechanics.compiled.layout import (
    ArrayField,
    Field,
    Layout,
    ScalarField,
    StructField,
    check_array,
    layout_of,
)
from trocar.services.mechanics.compiled.struct_type import StructType, load_word

S_co = TypeVar("S_co", bound="Struct", covariant=True)


class Address(int, Generic[S_co]):
    """Address of a struct of type ``S_co``: an int, typed for type checkers."""


@dataclass_transform(kw_only_default=True)
class Struct:
    """Base of all structs.

    A field is annotated with ``float``, ``int`` or ``bool``, with another struct, or as an array with its extents,
    ``Annotated[FloatArray, "n", 3]``: a number is fixed, a name stands for the same extent in all fields of a struct.
    Numbers may have a default, everything else must be given.

    Python reads a number as a kernel last wrote it. An array may be replaced by one of the same extents. A struct
    cannot be copied or pickled, as it contains addresses, and is not thread-safe.
    Raises TypeError or ValueError: a field is missing, unknown, of another type, dtype, number of dimensions or extent,
    or not contiguous. The message begins with its name.

    Attributes:
        address: Address[Self]. Argument for kernels; valid as long as the object lives.
    """

    layout: ClassVar[Layout]
    _fields: ClassVar[dict[str, Field]]
    _defaults: ClassVar[dict[str, float]]
    _type: ClassVar[StructType]
    address: Address[Self]

    def __init_subclass__(cls) -> None:
        cls.layout = layout_of(cls, Struct)
        cls._fields = dict(cls.layout.fields)
        cls._type = StructType(cls.layout)
        cls._defaults = {name: cls.__dict__[name] for name in cls._fields if name in cls.__dict__}
        for name, field in cls._fields.items():
            if isinstance(field, ScalarField):
                setattr(cls, name, _number(f"{cls.__name__}.{name}", field))
            elif name in cls._defaults:
                raise TypeError(f"{cls.__name__}.{name}: only numbers have a default")

    def __init__(self, **values: Any) -> None:
        layout = self.layout
        _refuse(self, "no such field", values.keys() - self._fields.keys())
        _refuse(self, "is missing", self._fields.keys() - self._defaults.keys() - values.keys())
        words = (ctypes.c_int64 * layout.n_words)()
        words[0] = layout.tag
        floats = (ctypes.c_double * layout.n_words).from_buffer(words)
        vars(self).update(_words=words, _floats=floats, address=ctypes.addressof(words), _extents={})
        for name, value in (self._defaults | values).items():
            setattr(self, name, value)

    @classmethod
    def zeros(cls, **given: Any) -> Self:
        """Return a struct of zeros; ``given`` are extents by name, and the fields with other values."""
        extents = {name: given.pop(name) for name, _ in cls.layout.extents if name in given}
        values = dict(given)
        for name, field in cls._fields.items():
            if name in given or name in cls._defaults or isinstance(field, StructField):
                continue
            if isinstance(field, ScalarField):
                values[name] = False if field.kind == "bool" else 0
                continue
            lacking = [extent for extent in field.extents if isinstance(extent, str) and extent not in extents]
            if lacking:
                raise TypeError(f"{cls.__name__}.{name}: extent '{lacking[0]}' is missing")
            shape = [extents[extent] if isinstance(extent, str) else extent for extent in field.extents]
            values[name] = np.zeros(shape, field.dtype)
        return cls(**values)

    def __setattr__(self, name: str, value: Any) -> None:
        field = self._fields.get(name)
        if isinstance(field, ScalarField):
            object.__setattr__(self, name, value)
            return
        label = f"{type(self).__name__}.{name}"
        if isinstance(field, ArrayField):
            self._put_array(label, field, value)
        elif isinstance(field, StructField):
            if not isinstance(value, Struct) or value.layout != field.layout:
                raise TypeError(f"{label}: expected a {field.layout.name}, got {type(value).__name__}")
            vars(self)["_words"][field.word] = value.address
        else:
            raise AttributeError(f"{label}: no such field")
        vars(self)[name] = value

    def put_zero(self, *names: str) -> None:
        """Set numbers to zero, in a third of the time of an assignment."""
        state, fields = self.__dict__, self._fields
        words = state["_words"]
        for name in names:
            words[fields[name].word] = 0

    def own_memory(self) -> tuple[np.ndarray[Any, Any], ...]:
        """Return its words and its arrays, without those of nested structs, for copying and restoring.

        No array may be replaced afterwards.
        """
        arrays = (getattr(self, name) for name, field in self.layout.fields if isinstance(field, ArrayField))
        return np.frombuffer(vars(self)["_words"], np.int64), *arrays

    def _put_array(self, label: str, field: ArrayField, value: object) -> None:
        array, known = check_array(label, field, value), vars(self)["_extents"]
        words, places = vars(self)["_words"], dict(self.layout.extents)
        for name, extent in zip(field.extents, array.shape, strict=True):
            if isinstance(name, str) and known.setdefault(name, extent) != extent:
                raise ValueError(f"{label}: expected a {field} with {name} = {known[name]}, got shape {array.shape}")
            if isinstance(name, str):
                words[places[name]] = extent
        words[field.word] = array.ctypes.data

    def __reduce__(self) -> NoReturn:
        raise TypeError(f"a {type(self).__name__} holds addresses: it is neither copied nor pickled")


def _refuse(struct: Struct, what: str, names: set[str]) -> None:
    if names:
        raise TypeError(f"{type(struct).__name__}.{min(names)}: {what}")


_PLAIN = {"float": float, "int": int, "bool": bool}


def _number(label: str, field: ScalarField) -> property:
    word, store, plain = field.word, "_floats" if field.kind == "float" else "_words", _PLAIN[field.kind]

    def get(struct: Any) -> float:
        value: float = struct.__dict__[store][word]
        return value

    def get_bool(struct: Any) -> bool:
        return bool(struct.__dict__[store][word])

    def put(struct: Any, value: float) -> None:
        # An isinstance check against an abstract class takes longer than a small kernel.
        number = value if type(value) is plain else _checked_number(label, field, value)
        struct.__dict__[store][word] = number

    return property(get_bool if field.kind == "bool" else get, put)


def _checked_number(label: str, field: ScalarField, value: object) -> float:
    if field.kind == "float" and isinstance(value, numbers.Real):
        return float(value)
    if field.kind == "int" and isinstance(value, numbers.Integral):
        return operator.index(value)
    if field.kind == "bool" and isinstance(value, bool | np.bool_):
        return bool(value)
    raise TypeError(f"{label}: expected {field.kind}, got {value!r}")


def reader(kind: type[S_co]) -> Callable[[Address[S_co]], S_co]:
    """Return a function that turns an address into the struct, inside kernels.

    It raises TypeError if there is no struct of this kind at the address.
    """
    struct, tag = kind._type, kind.layout.tag  # noqa: SLF001 - one subject
    message = f"the address of a {kind.__name__} is wanted"

    @intrinsic
    def read(_context: Any, address: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            pointer = builder.inttoptr(arguments[0], context.get_value_type(struct))
            found = load_word(builder, pointer, 0, is_constant=True)
            with builder.if_then(builder.icmp_signed("!=", found, found.type(tag)), likely=False):
                context.call_conv.return_user_exc(builder, TypeError, (message,))
            return pointer

        return struct(address), generate

    checked: Callable[[Address[S_co]], S_co] = read
    return checked


@typeof_impl.register(Struct)
def _typeof(struct: Struct, _context: Any) -> StructType:
    return struct._type  # noqa: SLF001


@unbox(StructType)
def _unbox(kind: StructType, struct: Any, c: Any) -> NativeValue:
    """Convert a struct that Python passes to a kernel directly; 2 us, so not for every tick."""
    address = c.pyapi.object_getattr_string(struct, "address")
    value = c.builder.inttoptr(c.pyapi.long_as_longlong(address), c.context.get_value_type(kind))
    c.pyapi.decref(address)
    return NativeValue(value)
