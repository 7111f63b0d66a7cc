"""Encoding of many alike protobuf messages of one length without the library, by filling a template."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache

import numpy as np
import numpy.typing as npt

_FIXED64, LENGTH = 1, 2  # wire types by https://protobuf.dev/programming-guides/encoding/#structure
_DOUBLE = np.dtype(np.float64).itemsize
#: Field number and number of doubles of each part of a message.
Layout = tuple[tuple[int, int], ...]
POINT: Layout = ((1, 1), (2, 1), (3, 1))  # fields x, y and z of one number each, by foxglove.Point3


def field(number: int, content: bytes) -> bytes:
    """Return a field that holds a message, a string or packed numbers."""
    return varint(number << 3 | LENGTH) + varint(len(content)) + content


def varint(value: int) -> bytes:
    """Return the encoding of a non-negative integer."""
    low, rest = value & 0x7F, value >> 7
    return bytes([low | 0x80]) + varint(rest) if rest else bytes([low])


def rows(numbers: npt.NDArray[np.float64], layout: Layout, number: int) -> bytes:
    """Return the encoding of the repeated field `number`: a message of doubles for each row of (n, columns)."""
    template, slots = _template(layout, number)
    messages = np.tile(template, (len(numbers), 1))
    messages[:, slots] = np.ascontiguousarray(numbers).view(np.uint8).reshape(len(numbers), len(slots))
    return messages.tobytes()


@cache
def _template(layout: Layout, number: int) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.intp]]:
    """Return a message with its tag and length, and the position of each byte of a row in it."""
    message, slots = b"", list[int]()
    for place, count in layout:
        message += varint(place << 3 | (LENGTH if count > 1 else _FIXED64))
        message += varint(_DOUBLE * count) if count > 1 else b""
        slots += range(len(message), len(message) + _DOUBLE * count)
        message += bytes(_DOUBLE * count)
    head = field(number, message)[: -len(message)]
    return np.frombuffer(head + message, np.uint8), np.array(slots) + len(head)


def joined(parts: Iterable[bytes]) -> bytes:
    """Return the concatenation of messages of one type, which is one message (…/encoding/#last-one-wins)."""
    return b"".join(parts)
