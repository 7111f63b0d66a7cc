"""The fields of a body as everybody sees them: the one walk over the types of the wire.

Checks, documentation, recordings and tests are made from what it finds, so none of them knows Python's type hints. A
body that declares something else than is listed at `FieldForm` is refused here, with the field's name.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from enum import Enum, auto
from functools import cache
from typing import Any

import msgspec
from msgspec import inspect

from trocar.protocol.arrays import Array, Spec

Body = type[msgspec.Struct]

_SCALARS: dict[type[inspect.Type], type] = {
    inspect.IntType: int,
    inspect.FloatType: float,
    inspect.StrType: str,
    inspect.BoolType: bool,
    inspect.RawType: msgspec.Raw,
}
_LIMITS = ("ge", "gt", "le", "lt", "max_length")


class FieldForm(Enum):
    """How a field holds its items."""

    ONE = auto()
    OPTIONAL = auto()  # one, or None
    MANY = auto()  # tuple[item, ...]
    FIXED = auto()  # tuple of so many items of one type
    MAP = auto()  # dict[str, item]
    ARRAY = auto()  # a numeric array that says what it is with `trocar.protocol.arrays.spec`


@dataclass(frozen=True, slots=True)
class Field:
    """One position of a body.

    Attributes:
        name, form
        item: int, float, str, bool or a body type; `Array` for an array, `msgspec.Raw` for what stays unread.
        count: Number of items where that is fixed, else 1.
        limits: "ge", "gt", "le" and "lt" of a number, "max_length" of a word, a tuple or a map: those that are
            declared.
        description: What the declaration says of it; of an array, the unit.
        spec: Of an array.
    """

    name: str
    form: FieldForm
    item: Any
    count: int = 1
    limits: Mapping[str, float] = field(default_factory=dict)
    description: str = ""
    spec: Spec | None = None

    @property
    def body(self) -> Body | None:
        """The body type that is nested here, if any."""
        return self.item if self.item not in (*_SCALARS.values(), Array) else None


@cache
def fields(body: Body) -> tuple[Field, ...]:
    """Return the fields of `body` by position.

    Raises TypeError naming a field whose type does not travel, or an array without a spec.
    """
    described = inspect.type_info(body)
    assert isinstance(described, inspect.StructType), body
    return tuple(_field(f"{body.__name__}.{row.name}", row.name, row.type) for row in described.fields)


@cache
def arrays(body: Body) -> tuple[tuple[str, Spec], ...]:
    """Return name and declaration of the numeric arrays of `body`."""
    return tuple((each.name, each.spec) for each in fields(body) if each.spec is not None)


def nested(body: Body) -> Iterator[Body]:
    """Yield the body types within `body`, each once, before those within them."""
    seen: set[Body] = set()

    def below(outer: Body) -> Iterator[Body]:
        for inner in [each.body for each in fields(outer) if each.body is not None]:
            if inner not in seen:
                seen.add(inner)
                yield inner
                yield from below(inner)

    return below(body)


def _field(where: str, name: str, kind: inspect.Type) -> Field:
    description, extra = "", {}
    if isinstance(kind, inspect.Metadata):
        description, extra = (kind.extra_json_schema or {}).get("description", ""), kind.extra or {}
        kind = kind.type
    limits = {key: value for key in _LIMITS if (value := getattr(kind, key, None)) is not None}
    form, count, item = _form(where, kind)
    spec = extra.get("array")
    if form is FieldForm.ARRAY and spec is None:
        raise TypeError(f"{where}: an array needs a spec(dtype, shape, unit)")
    return Field(name, form, item, count, limits, spec.unit if spec else description, spec)


def _form(where: str, kind: inspect.Type) -> tuple[FieldForm, int, Any]:
    if isinstance(kind, inspect.StructType) and kind.cls is Array:
        return FieldForm.ARRAY, 1, Array
    if isinstance(kind, inspect.VarTupleType):
        return FieldForm.MANY, 1, _item(where, kind.item_type)
    if isinstance(kind, inspect.TupleType) and len({type(part) for part in kind.item_types}) == 1:
        return FieldForm.FIXED, len(kind.item_types), _item(where, kind.item_types[0])
    if isinstance(kind, inspect.DictType) and isinstance(kind.key_type, inspect.StrType):
        return FieldForm.MAP, 1, _item(where, kind.value_type)
    if isinstance(kind, inspect.UnionType) and kind.includes_none and len(kind.types) == 2:
        (inner,) = (part for part in kind.types if not isinstance(part, inspect.NoneType))
        return FieldForm.OPTIONAL, 1, _item(where, inner)
    return FieldForm.ONE, 1, _item(where, kind)


def _item(where: str, kind: inspect.Type) -> Any:
    if isinstance(kind, inspect.Metadata):
        kind = kind.type
    if isinstance(kind, inspect.StructType) and kind.cls is not Array:
        return kind.cls
    if type(kind) not in _SCALARS:
        raise TypeError(
            f"{where}: {type(kind).__name__} does not travel; see trocar.protocol.fields.Form for what does"
        )
    return _SCALARS[type(kind)]
