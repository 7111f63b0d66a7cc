"""Frames of the bus as protobuf messages, made and serialised by protobuf's own library.

Most bytes of a frame are arrays. A packed repeated field and a `bytes` field look the same in a serialised message: a
tag, a length and the content (https://protobuf.dev/programming-guides/encoding/#packed). So the library is handed the
arrays as bytes, and copies them; the schema in the file declares the numbers that they are.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from operator import attrgetter
from typing import Any

import msgspec
from google.protobuf import descriptor_pool, message_factory
from google.protobuf.message import Message

from protocol import Frame
from protocol.fields import Field, Form, fields
from services.recorder.schema import PACKAGE, Envelope, file_descriptor, is_copied

Convert = Callable[[Any], Any]
_INT64_MAX = (1 << 63) - 1


def to_protobuf(frame: Frame) -> bytes:
    """Return body and envelope of `frame` as the serialised message of its topic."""
    body: msgspec.Struct = frame.body
    values = _values(type(body), body)
    return _message_class(type(body))(**values, envelope=_values(Envelope, frame)).SerializeToString()


@cache
def _message_class(body: type[msgspec.Struct]) -> type[Message]:
    pool = descriptor_pool.DescriptorPool()
    for file in file_descriptor(body, arrays_as_bytes=True).file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(f"{PACKAGE}.{body.__name__}"))


def _values(kind: type[msgspec.Struct], body: msgspec.Struct) -> dict[str, Any]:
    """Return the fields of `kind` that `body` has, as the constructor of a message takes them; None is left out."""
    return {
        name: getattr(body, name) if convert is None else convert(getattr(body, name))
        for name, convert in _converters(kind)
    }


@cache
def _converters(kind: type[msgspec.Struct]) -> tuple[tuple[str, Convert | None], ...]:
    return tuple((field.name, _converter(field)) for field in fields(kind))


def _converter(field: Field) -> Convert | None:
    """Return what makes of a field's value what the library takes; None where it takes the value itself."""
    if field.form is Form.ARRAY:
        return attrgetter("data") if is_copied(field) else lambda array: array.view().ravel().tolist()
    item = _item_converter(field)
    if item is None or field.form is Form.ONE:
        return item
    if field.form is Form.OPTIONAL:
        return lambda value: None if value is None else item(value)
    if field.form is Form.MAP:
        return lambda value: {key: item(each) for key, each in value.items()}
    return lambda value: list(map(item, value))


def _item_converter(field: Field) -> Convert | None:
    body = field.body
    if body is not None:
        return lambda value: _values(body, value)
    return _to_int64 if field.item is int else None


def _to_int64(value: int) -> int:
    """Return `value`, or for one of 64 bits its two's complement: the wire's integers may be unsigned."""
    return value if value <= _INT64_MAX else value - (1 << 64)
