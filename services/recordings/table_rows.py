"""The rows of a table as messages of a repeated field: all are of one length, so they are copied into a template."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from typing import Any

import msgspec
import numpy as np
import numpy.typing as npt

from protocol.arrays import Array
from protocol.fields import fields
from protocol.table import TableRow

_FIXED64, _LENGTH = 1, 2  # wire types, https://protobuf.dev/programming-guides/encoding/#structure
_DOUBLE = 8


def encoded_rows(table: Array, row: type[msgspec.Struct], number: int) -> bytes:
    """Return what a message holds of `table` (n, columns) in its repeated field `number`."""
    template, slots = _template(row, number)
    count = table.shape[0]
    messages = np.tile(template, (count, 1))
    messages[:, slots] = np.frombuffer(table.data, np.uint8).reshape(count, len(slots))
    return messages.tobytes()


def decoded_rows(messages: Iterable[Any], row: type[msgspec.Struct]) -> Array:
    """Return the table of messages of protobuf's library.

    Raises
    ------
    ValueError
        if a vector in one has another length than the column.
    """
    assert issubclass(row, TableRow)
    rows = [[getattr(message, name) for name in row.order()] for message in messages]
    numbers = [np.concatenate([np.atleast_1d(value) for value in values]) for values in rows]
    columns = sum(field.count for field in fields(row))
    if any(len(each) != columns for each in numbers):
        raise ValueError(f"a row of {row.__name__} has not {columns} numbers")
    return Array("<f8", (len(numbers), columns), np.array(numbers, "<f8").tobytes())


@cache
def _template(row: type[msgspec.Struct], number: int) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.intp]]:
    """Return a message with its tag and length, and the place of each byte of a row in it."""
    assert issubclass(row, TableRow)
    numbers = {field.name: (place, field.count) for place, field in enumerate(fields(row), start=1)}
    message, slots = b"", list[int]()
    for name in row.order():
        place, count = numbers[name]
        message += _varint(place << 3 | (_LENGTH if count > 1 else _FIXED64))
        message += _varint(_DOUBLE * count) if count > 1 else b""
        slots += range(len(message), len(message) + _DOUBLE * count)
        message += bytes(_DOUBLE * count)
    head = _varint(number << 3 | _LENGTH) + _varint(len(message))
    return np.frombuffer(head + message, np.uint8), np.array(slots) + len(head)


def _varint(value: int) -> bytes:
    low, rest = value & 0x7F, value >> 7
    return bytes([low | 0x80]) + _varint(rest) if rest else bytes([low])
