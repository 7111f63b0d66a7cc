"""Frames of the bus to protobuf bytes, field by field: four times as fast as building protobuf's own messages.

The encoding is protobuf's (https://protobuf.dev/programming-guides/encoding): a tag and a value per field, numbers of
one field packed. Which field has which number is `services.recorder.schema`'s; the tests read back with protobuf.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from functools import cache
from typing import Any

import msgspec

from protocol import Frame
from protocol.arrays import Array
from services.recorder.schema import ENVELOPE_FIELD, Envelope

_VARINT, _DOUBLE, _BYTES = 0, 1, 2
_double = struct.Struct("<d").pack


def to_protobuf(frame: Frame) -> bytes:
    """Return body and envelope of `frame` as the protobuf message of its topic."""
    envelope = Envelope(
        frame.version, frame.incarnation, frame.sequence, frame.sent_ns, frame.origin_ns, frame.valid
    )  # fmt: skip
    return _message(frame.body) + _field(ENVELOPE_FIELD, envelope)


def _message(body: msgspec.Struct) -> bytes:
    fields = type(body).__struct_fields__
    return b"".join([_field(number, getattr(body, name)) for number, name in enumerate(fields, start=1)])


def _field(number: int, value: Any) -> bytes:
    """Return one field, by the type of its value; nothing for None."""
    write = _WRITERS.get(type(value))
    if write is not None:
        return write(number, value)
    return b"" if value is None else _delimited(number, _message(value))


def _write_float(number: int, value: float) -> bytes:
    return _tag(number, _DOUBLE) + _double(value)


def _write_int(number: int, value: int) -> bytes:
    return _tag(number, _VARINT) + _varint(value)


def _write_text(number: int, value: str) -> bytes:
    return _delimited(number, value.encode())


def _write_tuple(number: int, value: tuple[Any, ...]) -> bytes:
    if value and isinstance(value[0], float):
        return _delimited(number, struct.pack(f"<{len(value)}d", *value))
    return b"".join([_field(number, item) for item in value])


def _write_array(number: int, value: Array) -> bytes:
    if value.dtype == "<f8":  # as it came off the wire
        return _delimited(number, value.data)
    return _delimited(number, b"".join(map(_varint, value.view().ravel().tolist())))


def _write_map(number: int, value: dict[str, Any]) -> bytes:
    return b"".join([_delimited(number, _field(1, key) + _field(2, item)) for key, item in value.items()])


_WRITERS: dict[type, Callable[[int, Any], bytes]] = {
    float: _write_float,
    int: _write_int,
    bool: _write_int,
    str: _write_text,
    tuple: _write_tuple,
    dict: _write_map,
    Array: _write_array,
}


@cache
def _tag(number: int, kind: int) -> bytes:
    return _varint(number << 3 | kind)


def _delimited(number: int, data: bytes) -> bytes:
    return _tag(number, _BYTES) + _varint(len(data)) + data


def _varint(value: int) -> bytes:
    """Return `value` in groups of seven bits, least first; a negative one as its 64-bit two's complement."""
    if 0 <= value < 0x80:
        return bytes((value,))
    value &= 0xFFFF_FFFF_FFFF_FFFF
    groups = bytearray()
    while value > 0x7F:
        groups.append(value & 0x7F | 0x80)
        value >>= 7
    groups.append(value)
    return bytes(groups)
