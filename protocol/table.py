"""Tables on the wire: two-dimensional arrays of which each row is a `TableRow`, its numbers side by side.

The fields of the row's type are the columns, so where a column begins is known in one place: kernels and encoders take
it from `columns`.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from itertools import chain
from typing import Any, ClassVar, Self

import msgspec
import numpy as np

from trocar.protocol.arrays import Array, pack
from trocar.protocol.fields import Field, fields

#: No count is larger, whatever a table says, so that sums of them fit 64 bits.
_COUNT_MAX = 2.0**31


class TableRow(msgspec.Struct, array_like=True, frozen=True, kw_only=True):
    """A row of a table by its names.

    Its fields are numbers, counts, truth values and vectors; their columns come in the order of declaration, or in that
    of ``TABLE_ORDER``.
    """

    TABLE_ORDER: ClassVar[tuple[str, ...]] = ()

    def row(self) -> tuple[float, ...]:
        """Return it as it travels, (columns,)."""
        values = (getattr(self, name) for name in _first(type(self)))
        return tuple(chain.from_iterable(v if isinstance(v, tuple) else (float(v),) for v in values))

    @classmethod
    def order(cls) -> tuple[str, ...]:
        """Return the names of the fields in the order of the table."""
        return tuple(_first(cls))

    @classmethod
    def from_row(cls, row: Sequence[float]) -> Self:
        """Return what travels as ``row`` (columns,).

        Raises msgspec.ValidationError if a number is out of the range that its field declares.
        """
        first = _first(cls)
        return msgspec.convert([_value(field, row, first[field.name]) for field in fields(cls)], cls)

    @classmethod
    def table(cls, rows: Sequence[Self]) -> Array:
        """Return rows as they travel, (rows, columns)."""
        return pack(np.array([row.row() for row in rows]).reshape(len(rows), columns(cls)[-1]))


def columns(kind: type[TableRow]) -> tuple[int, ...]:
    """Return the first column of each field of ``kind`` in the order of the table, and last the number of columns."""
    return (*_first(kind).values(), sum(field.count for field in fields(kind)))


@cache
def _first(kind: type[TableRow]) -> dict[str, int]:
    """Return the first column of each field, in the order of the table."""
    named = {field.name: field for field in fields(kind)}
    first, at = {}, 0
    for name in kind.TABLE_ORDER or named:
        first[name], at = at, at + named[name].count
    return first


def _value(field: Field, row: Sequence[float], at: int) -> Any:
    if field.count > 1:
        return [float(number) for number in row[at : at + field.count]]
    if field.item is int:
        return int(min(max(row[at], 0.0), _COUNT_MAX))
    return field.item(row[at])
