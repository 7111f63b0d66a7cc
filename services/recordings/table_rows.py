"""Encoding of a table's rows as messages of a repeated field, with fields named like the columns."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from typing import Any

import msgspec
import numpy as np

from trocar.protocol.arrays import Array
from trocar.protocol.fields import fields
from trocar.protocol.table import TableRow
from trocar.services.recordings import encoded


def encoded_rows(table: Array, row: type[msgspec.Struct], number: int) -> bytes:
    """Return the encoding of `table` (n, columns) in the repeated field `number` of a message."""
    return encoded.rows(table.view(), _layout(row), number)


def decoded_rows(messages: Iterable[Any], row: type[msgspec.Struct]) -> Array:
    """Return the table of messages of protobuf's library.

    Raises ValueError if a vector has another length than its column.
    """
    assert issubclass(row, TableRow)
    rows = [[getattr(message, name) for name in row.order()] for message in messages]
    numbers = [np.concatenate([np.atleast_1d(value) for value in values]) for values in rows]
    columns = sum(field.count for field in fields(row))
    if any(len(each) != columns for each in numbers):
        raise ValueError(f"a row of {row.__name__} has not {columns} numbers")
    return Array("<f8", (len(numbers), columns), np.array(numbers, "<f8").tobytes())


@cache
def _layout(row: type[msgspec.Struct]) -> encoded.Layout:
    assert issubclass(row, TableRow)
    numbers = {field.name: (place, field.count) for place, field in enumerate(fields(row), start=1)}
    return tuple(numbers[name] for name in row.order())
