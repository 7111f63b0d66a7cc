"""Protobuf schemas of the bodies, made from what the wire contract declares: nothing to keep in step by hand.

Position p of a body is field number p + 1, so a body that only grows keeps its numbers. Vectors and arrays are packed
repeated numbers in C order. The envelope travels as field 1000.
"""

from __future__ import annotations

import types
from functools import cache
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

import msgspec
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.message import Message

from protocol.arrays import Array, Spec

PACKAGE = "trocar"
ENVELOPE_FIELD = 1000

_Field = descriptor_pb2.FieldDescriptorProto
_SCALARS = {int: _Field.TYPE_INT64, float: _Field.TYPE_DOUBLE, str: _Field.TYPE_STRING, bool: _Field.TYPE_BOOL}
_ITEMS = {"f": _Field.TYPE_DOUBLE, "i": _Field.TYPE_INT64}


class Envelope(msgspec.Struct, array_like=True):
    """What a recording keeps of a frame's envelope."""

    version: int
    incarnation: int
    sequence: int
    sent_ns: int
    origin_ns: int
    valid: bool


@cache
def file_descriptor(body: type[msgspec.Struct]) -> descriptor_pb2.FileDescriptorSet:
    """Return the self-contained descriptor set of `body`."""
    file = descriptor_pb2.FileDescriptorProto(name=f"{PACKAGE}/{body.__name__}.proto", package=PACKAGE, syntax="proto3")
    _add_message(file, Envelope, set())
    _add_message(file, body, {Envelope})
    root = next(message for message in file.message_type if message.name == body.__name__)
    root.field.add(
        name="envelope", number=ENVELOPE_FIELD, label=_Field.LABEL_OPTIONAL, type=_Field.TYPE_MESSAGE,
        type_name=f".{PACKAGE}.Envelope",
    )  # fmt: skip
    return descriptor_pb2.FileDescriptorSet(file=[file])


@cache
def message_class(body: type[msgspec.Struct]) -> type[Message]:
    """Return the protobuf class of `body`. Each body has a pool of its own: nested names repeat between them."""
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file_descriptor(body).file[0])
    kind: type[Message] = message_factory.GetMessageClass(pool.FindMessageTypeByName(f"{PACKAGE}.{body.__name__}"))
    return kind


def _add_message(
    file: descriptor_pb2.FileDescriptorProto, body: type[msgspec.Struct], done: set[type[msgspec.Struct]]
) -> None:
    done.add(body)
    message = descriptor_pb2.DescriptorProto(name=body.__name__)
    hints = get_type_hints(body, include_extras=True)
    for number, name in enumerate(body.__struct_fields__, start=1):
        nested = _add_field(message, name, number, hints[name])
        if nested is not None and nested not in done:
            _add_message(file, nested, done)
    file.message_type.append(message)


def _add_field(
    message: descriptor_pb2.DescriptorProto, name: str, number: int, hint: Any
) -> type[msgspec.Struct] | None:
    """Add one field; return the body nested in it, if any."""
    extras = get_args(hint)[1:] if get_origin(hint) is Annotated else ()
    bare = get_args(hint)[0] if extras else hint
    if isinstance(bare, types.UnionType) or get_origin(bare) is Union:
        bare = next(part for part in get_args(bare) if part is not type(None))
    if get_origin(bare) is dict:
        _add_map(message, name, number, get_args(bare)[1])
        return None
    repeated = get_origin(bare) is tuple or bare is Array
    item = get_args(bare)[0] if get_origin(bare) is tuple else bare
    field = message.field.add(
        name=name, number=number, label=_Field.LABEL_REPEATED if repeated else _Field.LABEL_OPTIONAL
    )
    if bare is Array:
        field.type = _ITEMS[next(extra for extra in extras if isinstance(extra, Spec)).dtype[1]]
        return None
    if item in _SCALARS:
        field.type = _SCALARS[item]
        return None
    field.type = _Field.TYPE_MESSAGE
    field.type_name = f".{PACKAGE}.{item.__name__}"
    return item  # type: ignore[no-any-return]


def _add_map(message: descriptor_pb2.DescriptorProto, name: str, number: int, value: type) -> None:
    entry = message.nested_type.add(name=f"{name.title().replace('_', '')}Entry")
    entry.options.map_entry = True
    entry.field.add(name="key", number=1, type=_Field.TYPE_STRING, label=_Field.LABEL_OPTIONAL)
    entry.field.add(name="value", number=2, type=_SCALARS[value], label=_Field.LABEL_OPTIONAL)
    message.field.add(
        name=name, number=number, label=_Field.LABEL_REPEATED, type=_Field.TYPE_MESSAGE,
        type_name=f".{PACKAGE}.{message.name}.{entry.name}",
    )  # fmt: skip
