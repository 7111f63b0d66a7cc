"""Conversion of bus frames to protobuf messages and back, with protobuf's own library.

Most bytes of a frame are arrays. A packed repeated field and a `bytes` field are serialised alike: a tag, a length and
the content (https://protobuf.dev/programming-guides/encoding/#packed). So the library gets the arrays as bytes, and
copies them, while the schema in the file declares numbers. Concatenated messages are one message
(…/encoding/#last-one-wins), so tables are appended to the library's output.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from math import prod
from operator import attrgetter
from typing import Any

import msgspec
import numpy as np
from google.protobuf import descriptor_pool, message_factory
from google.protobuf.message import Message

from trocar.protocol import PROTOCOL_VERSION, TOPICS, Frame, soundness, upgrades
from trocar.protocol.arrays import Array, Spec, pack
from trocar.protocol.fields import Field, FieldForm, fields
from trocar.services.recordings.schema import PACKAGE, Envelope, file_descriptor, is_copied
from trocar.services.recordings.table_rows import decoded_rows, encoded_rows

Convert = Callable[[Any], Any]
_INT64_MAX = int(np.iinfo(np.int64).max)


class _Anything(msgspec.Struct):
    """Message type with only the envelope."""


def to_protobuf(frame: Frame) -> bytes:
    """Return body and envelope of `frame` as a serialised message of its topic."""
    body: msgspec.Struct = frame.body
    values = _values(type(body), body)
    message = _message_class(type(body))(**values, envelope=_values(Envelope, frame)).SerializeToString()
    tables = (encoded_rows(getattr(body, name), row, number) for name, row, number in _tables(type(body)))
    return b"".join((message, *tables))


def to_frame(topic: str, data: bytes) -> Frame:
    """Return the frame in a serialised message of `topic`, its body converted to the current version.

    Raises ValueError if a body does not fit its type, or is of an unsupported version. Raises
    google.protobuf.message.DecodeError if it is no message.
    """
    row = TOPICS[topic]
    envelope = _message_class(_Anything).FromString(data).envelope
    kind = upgrades.body_type(row, envelope.version)
    if kind is None:
        raise ValueError(f"version {envelope.version} of its body is not known")
    body = _body(kind, _message_class(kind).FromString(data))
    if not soundness.check(kind, finite_scalars=False, finite_arrays=False)(body):
        raise ValueError("its arrays differ from their declaration")
    return Frame(
        PROTOCOL_VERSION, topic, row.version, envelope.incarnation % (1 << 64), envelope.sequence, envelope.sent_ns,
        envelope.origin_ns, envelope.valid, upgrades.lift(row, envelope.version, body),
    )  # fmt: skip


@cache
def _message_class(body: type[msgspec.Struct]) -> Any:
    pool = descriptor_pool.DescriptorPool()
    for file in file_descriptor(body, arrays_as_bytes=True).file:
        pool.Add(file)
    found: type[Message] = message_factory.GetMessageClass(pool.FindMessageTypeByName(f"{PACKAGE}.{body.__name__}"))
    return found


@cache
def _tables(kind: type[msgspec.Struct]) -> tuple[tuple[str, type[msgspec.Struct], int], ...]:
    """Return name, type of rows and field number of the tables of a body."""
    numbered = enumerate(fields(kind), start=1)
    return tuple((each.name, each.spec.row, n) for n, each in numbered if each.spec and each.spec.row)


def _values(kind: type[msgspec.Struct], body: msgspec.Struct) -> dict[str, Any]:
    """Return the fields of `body` that `kind` has, as arguments of a message's constructor, without None."""
    return {
        name: getattr(body, name) if convert is None else convert(getattr(body, name))
        for name, convert in _converters(kind)
    }


@cache
def _converters(kind: type[msgspec.Struct]) -> tuple[tuple[str, Convert | None], ...]:
    return tuple(
        (field.name, _converter(field)) for field in fields(kind) if field.spec is None or field.spec.row is None
    )


def _converter(field: Field) -> Convert | None:
    """Return a function that converts a field's value for the library; None if none is needed."""
    if field.form is FieldForm.ARRAY:
        return attrgetter("data") if is_copied(field) else lambda array: array.view().ravel().tolist()
    item = _item_converter(field)
    if item is None or field.form is FieldForm.ONE:
        return item
    if field.form is FieldForm.OPTIONAL:
        return lambda value: None if value is None else item(value)
    if field.form is FieldForm.MAP:
        return lambda value: {key: item(each) for key, each in value.items()}
    return lambda value: list(map(item, value))


def _item_converter(field: Field) -> Convert | None:
    body = field.body
    if body is not None:
        return lambda value: _values(body, value)
    return _to_int64 if field.item is int else None


def _to_int64(value: int) -> int:
    """Return `value` as a signed 64-bit number (two's complement), as the wire's integers may be unsigned."""
    return value if value <= _INT64_MAX else value - (1 << 64)


def _body(kind: type[msgspec.Struct], message: Any) -> Any:
    return kind(**{name: read(message) for name, read in _readers(kind)})


@cache
def _readers(kind: type[msgspec.Struct]) -> tuple[tuple[str, Convert], ...]:
    return tuple((field.name, _reader(field)) for field in fields(kind))


def _reader(field: Field) -> Convert:
    """Return a function that reads a field's value from a message of the library."""
    value = attrgetter(field.name)
    if field.spec is not None:
        return _array_reader(field, field.spec)
    item: Convert | None = None
    body, name = field.body, field.name
    if body is not None:
        item = lambda inner: _body(body, inner)  # noqa: E731
    elif field.item is int and field.limits.get("ge", -1) >= 0:
        item = lambda number: number if number >= 0 else number + (1 << 64)  # noqa: E731
    if field.form is FieldForm.OPTIONAL:
        return lambda message: _or_none(message, name, item)
    if field.form is FieldForm.MAP:
        return lambda message: dict(value(message))
    if field.form is FieldForm.ONE:
        return value if item is None else lambda message: item(value(message))
    return lambda message: tuple(value(message)) if item is None else tuple(map(item, value(message)))


def _or_none(message: Any, name: str, item: Convert | None) -> Any:
    if not message.HasField(name):
        return None
    return getattr(message, name) if item is None else item(getattr(message, name))


def _array_reader(field: Field, spec: Spec) -> Convert:
    value = attrgetter(field.name)
    if spec.row is not None:
        row = spec.row
        return lambda message: decoded_rows(value(message), row)
    if not is_copied(field):
        return lambda message: pack(list(value(message)), spec.dtype)
    fixed = [length for length in spec.shape if not isinstance(length, str)]
    row_bytes = int(spec.dtype[2:]) * prod(fixed)
    named = len(spec.shape) - len(fixed)
    assert named <= 1, field.name

    def read(message: Any) -> Array:
        data = value(message)
        count = len(data) // row_bytes if row_bytes else 0
        return Array(spec.dtype, tuple(count if isinstance(n, str) else n for n in spec.shape), data)

    return read
