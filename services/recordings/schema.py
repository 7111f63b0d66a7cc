"""Protobuf schemas of the bodies, generated from the wire contract.

Position p of a body is field number p + 1, so appending fields keeps the numbers. Vectors and arrays are packed
repeated numbers in C order; a table is a message per row, with the names of its columns. The envelope is field 1000.
"""

from __future__ import annotations

from functools import cache

import msgspec
from google.protobuf import descriptor_pb2

from trocar.protocol.fields import Field, FieldForm, fields, nested

PACKAGE = "trocar"
ENVELOPE_FIELD = 1000  # beyond the fields of any body

_Field = descriptor_pb2.FieldDescriptorProto
_SCALARS = {int: _Field.TYPE_INT64, float: _Field.TYPE_DOUBLE, str: _Field.TYPE_STRING, bool: _Field.TYPE_BOOL}
#: Item types of arrays that are copied unchanged. A non-negative number of one byte is its own varint.
_ITEMS = {
    "<f8": _Field.TYPE_DOUBLE,
    "<i4": _Field.TYPE_SFIXED32,
    "<i8": _Field.TYPE_SFIXED64,
    "|i1": _Field.TYPE_INT64,
}


class Envelope(msgspec.Struct, array_like=True):
    """The recorded part of a frame's envelope."""

    version: int
    incarnation: int
    sequence: int
    sent_ns: int
    origin_ns: int
    valid: bool


def is_copied(field: Field) -> bool:
    """Return whether a field is an array of numbers of fixed size, whose bytes are copied into a message."""
    return field.spec is not None and field.spec.dtype != "|i1" and field.spec.row is None


@cache
def file_descriptor(body: type[msgspec.Struct], *, arrays_as_bytes: bool = False) -> descriptor_pb2.FileDescriptorSet:
    """Return the self-contained descriptor set of `body`.

    Args:
        body: A body type of the wire.
        arrays_as_bytes: Whether to declare copied arrays as `bytes`, which serialise alike, for writing.
    """
    file = descriptor_pb2.FileDescriptorProto(name=f"{PACKAGE}/{body.__name__}.proto", package=PACKAGE, syntax="proto3")
    rows = {field.spec.row for field in fields(body) if field.spec is not None and field.spec.row is not None}
    for row in sorted(rows, key=lambda each: each.__name__):
        _add_row(file, row)
    kinds: list[type[msgspec.Struct]] = [body, *nested(body), Envelope]
    for kind in kinds:
        _add_message(file, kind, arrays_as_bytes)
    file.message_type[len(rows)].field.add(
        name="envelope", number=ENVELOPE_FIELD, label=_Field.LABEL_OPTIONAL, type=_Field.TYPE_MESSAGE,
        type_name=f".{PACKAGE}.Envelope",
    )  # fmt: skip
    return descriptor_pb2.FileDescriptorSet(file=[file])


def _add_row(file: descriptor_pb2.FileDescriptorProto, row: type[msgspec.Struct]) -> None:
    """Declare a row of a table, whose columns are all doubles."""
    message = file.message_type.add(name=row.__name__)
    for number, field in enumerate(fields(row), start=1):
        label = _Field.LABEL_REPEATED if field.count > 1 else _Field.LABEL_OPTIONAL
        message.field.add(name=field.name, number=number, label=label, type=_Field.TYPE_DOUBLE)


def _add_message(file: descriptor_pb2.FileDescriptorProto, body: type[msgspec.Struct], arrays_as_bytes: bool) -> None:
    message = file.message_type.add(name=body.__name__)
    for number, field in enumerate(fields(body), start=1):
        if field.form is FieldForm.MAP:
            _add_map(message, field, number)
        elif arrays_as_bytes and is_copied(field):
            message.field.add(name=field.name, number=number, label=_Field.LABEL_OPTIONAL, type=_Field.TYPE_BYTES)
        else:
            _add_field(message, field, number)


def _add_field(message: descriptor_pb2.DescriptorProto, field: Field, number: int) -> None:
    single = field.form in (FieldForm.ONE, FieldForm.OPTIONAL)
    added = message.field.add(
        name=field.name, number=number, label=_Field.LABEL_OPTIONAL if single else _Field.LABEL_REPEATED
    )
    of = field.body if field.spec is None else field.spec.row
    if of is not None:
        added.type, added.type_name = _Field.TYPE_MESSAGE, f".{PACKAGE}.{of.__name__}"
    elif field.spec is not None:
        added.type = _ITEMS[field.spec.dtype]
    else:
        added.type = _SCALARS[field.item]
    if field.form is FieldForm.OPTIONAL and of is None:  # distinguishes a missing value from zero
        added.proto3_optional, added.oneof_index = True, len(message.oneof_decl)
        message.oneof_decl.add(name=f"_{field.name}")


def _add_map(message: descriptor_pb2.DescriptorProto, field: Field, number: int) -> None:
    entry = message.nested_type.add(name=f"{field.name.title().replace('_', '')}Entry")
    entry.options.map_entry = True
    entry.field.add(name="key", number=1, type=_Field.TYPE_STRING, label=_Field.LABEL_OPTIONAL)
    entry.field.add(name="value", number=2, type=_SCALARS[field.item], label=_Field.LABEL_OPTIONAL)
    message.field.add(
        name=field.name, number=number, label=_Field.LABEL_REPEATED, type=_Field.TYPE_MESSAGE,
        type_name=f".{PACKAGE}.{message.name}.{entry.name}",
    )  # fmt: skip
