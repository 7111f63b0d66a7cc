"""Frames of the bus to protobuf bytes: ten times as fast as building protobuf's own messages.

The encoding is protobuf's (https://protobuf.dev/programming-guides/encoding): a tag and a value per field, numbers of
one field packed. Which field has which number is `services.recorder.schema`'s; the tests read back with protobuf. What
a type needs (tags, lengths, which fields are numbers) is worked out once; a frame then costs a call or less per field.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from functools import cache, lru_cache
from types import FunctionType
from typing import Any, cast

import msgspec

from protocol import Frame
from protocol.fields import Field, Form, fields
from services.recorder.schema import ENVELOPE_FIELD

Write = Callable[[Any], bytes]
_VARINT, _DOUBLE, _BYTES = 0, 1, 2


def to_protobuf(frame: Frame) -> bytes:
    """Return body and envelope of `frame` as the protobuf message of its topic."""
    kind: type[msgspec.Struct] = type(frame.body)
    return _writer(kind)(frame.body) + _write_envelope(frame)


@cache
def _writer(body: type[msgspec.Struct]) -> Write:
    """Return what writes bodies of this type: one expression over its fields, made once and compiled.

    Protobuf lets the fields of a message stand in any order: all floating-point numbers and vectors are one call of
    `struct`, what is left is a call or less each. A loop over the fields takes twice as long.
    """
    source = _Source()
    for number, field in enumerate(fields(body), start=1):
        source.add(number, field)
    return source.compiled(body.__name__)


class _Source:
    """The expression that writes a body, and the constants in it."""

    def __init__(self) -> None:
        self._constants: dict[str, Any] = {}
        self._parts: list[str] = []
        self._format = "<"
        self._packed: list[str] = []

    def add(self, number: int, field: Field) -> None:
        """Add a field."""
        value = f"v.{field.name}"
        if field.item is float and field.form is Form.ONE:
            self._pack(_tag(number, _DOUBLE), "d", value)
        elif field.item is float and field.form is Form.FIXED:
            self._pack(_tag(number, _BYTES) + _varint(8 * field.count), f"{field.count}d", f"*{value}")
        elif field.item is bool and field.form is Form.ONE:
            self._pack(_tag(number, _VARINT), "?", value)
        elif field.item is int and field.form is Form.ONE:
            self._parts += [self._constant(_tag(number, _VARINT)), f"varint({value})"]
        elif field.form is Form.ARRAY and field.spec is not None and field.spec.dtype == "|i1":
            write = self._constant(_small_integers(_tag(number, _BYTES)))
            self._parts.append(f"{write}({value}.data)")
        elif field.form is Form.ARRAY:
            data = f"{value}.data"
            self._parts += [self._constant(_tag(number, _BYTES)), f"varint(len({data}))", data]
        else:
            self._parts.append(f"{self._constant(_field(number, field))}({value})")

    def compiled(self, name: str) -> Write:
        """Return the function."""
        parts = list(self._parts)
        if self._packed:
            pack = self._constant(struct.Struct(self._format).pack)
            parts.insert(0, f"{pack}({', '.join(self._packed)})")
        source = f"lambda v: join(({', '.join(parts)},))" if parts else 'lambda v: b""'
        code = compile(source, f"<protobuf of {name}>", "eval").co_consts[0]  # of the lambda, which nothing evaluates
        return cast(Write, FunctionType(code, {**self._constants, "join": b"".join, "varint": _varint}))

    def _pack(self, head: bytes, numbers: str, value: str) -> None:
        self._format += f"{len(head)}s{numbers}"
        self._packed += [self._constant(head), value]

    def _constant(self, value: Any) -> str:
        name = f"c{len(self._constants)}"
        self._constants[name] = value
        return name


def _field(number: int, field: Field) -> Write:
    match field.form:
        case Form.MANY if field.item is float:
            tag = _tag(number, _BYTES)
            return lambda value: _delimited(tag, struct.pack(f"<{len(value)}d", *value)) if value else b""
        case Form.MANY | Form.FIXED:
            write = _one(number, field.item)
            return lambda value: b"".join([write(item) for item in value])
        case Form.MAP:
            tag, key, item = _tag(number, _BYTES), _one(1, str), _one(2, field.item)
            return lambda value: b"".join([_delimited(tag, key(k) + item(v)) for k, v in value.items()])
        case Form.OPTIONAL:
            write = _one(number, field.item)
            return lambda value: b"" if value is None else write(value)
        case _:
            return _one(number, field.item)


def _one(number: int, item: Any) -> Write:
    """Return what writes a single item with its tag."""
    if item is float:
        tag, pack = _tag(number, _DOUBLE), struct.Struct("<d").pack
        return lambda value: tag + pack(value)
    if item is bool:
        return _booleans(number).__getitem__
    if item is int:
        tag = _tag(number, _VARINT)
        return lambda value: tag + _varint(value)
    tag = _tag(number, _BYTES)
    if item is str:  # names and states: the same few in every frame
        return lru_cache(64)(lambda value: _delimited(tag, value.encode()))
    write = _writer(item)
    return lambda value: _delimited(tag, write(value))


def _small_integers(tag: bytes) -> Write:
    """Return what writes integers of one byte: each is its own varint, but for negative ones."""
    return lambda data: _delimited(
        tag, data if data.isascii() else b"".join([_varint(value) for value in memoryview(data).cast("b")])
    )


def _booleans(number: int) -> tuple[bytes, bytes]:
    return _tag(number, _VARINT) + b"\0", _tag(number, _VARINT) + b"\1"


def _tag(number: int, kind: int) -> bytes:
    return _varint(number << 3 | kind)


def _delimited(tag: bytes, data: bytes) -> bytes:
    length = len(data)
    return tag + (_LAST[length] if length < _PAIR else _varint(length)) + data


def _varint(value: int) -> bytes:
    """Return `value` in groups of seven bits, least first; a negative one as its 64-bit two's complement."""
    if 0 <= value < _PAIR:
        return _LAST[value]
    value &= 0xFFFF_FFFF_FFFF_FFFF
    groups = b""
    while value >= _PAIR:
        groups += _PAIRS[value % _PAIR]
        value >>= 14
    return groups + _LAST[value]


#: Two groups that others follow, and up to two that end a number.
_PAIR = 1 << 14
_PAIRS = [bytes((value & 0x7F | 0x80, value >> 7 | 0x80)) for value in range(_PAIR)]
_LAST = [bytes((value,)) if value < 0x80 else bytes((value & 0x7F | 0x80, value >> 7)) for value in range(_PAIR)]

_TO_ENVELOPE = _tag(ENVELOPE_FIELD, _BYTES)
_SEQUENCE, _SENT, _ORIGIN, _VALID = (_tag(number, _VARINT) for number in (3, 4, 5, 6))


@lru_cache(64)
def _publisher(version: int, incarnation: int) -> bytes:
    """Return the fields of an envelope that are the same in every frame of a topic."""
    return _tag(1, _VARINT) + _varint(version) + _tag(2, _VARINT) + _varint(incarnation)


def _write_envelope(frame: Frame) -> bytes:
    """Return what the schema's `Envelope` keeps of `frame`."""
    envelope = (
        _publisher(frame.version, frame.incarnation)
        + (_SEQUENCE + _varint(frame.sequence))
        + (_SENT + _varint(frame.sent_ns))
        + (_ORIGIN + _varint(frame.origin_ns))
        + (_VALID + _LAST[frame.valid])
    )
    return _TO_ENVELOPE + _LAST[len(envelope)] + envelope
