"""Frames as any language would read them: plain msgpack, names and dtypes from the declared bodies."""

from __future__ import annotations

import math
import struct
from typing import Any

import msgpack
import msgspec

from trocar.protocol.fields import Field, FieldForm, fields
from trocar.protocol.frame import Header
from trocar.protocol.topics import TOPICS
from trocar.protocol.upgrades import body_type

_LONG = 12  # numbers that still fit a line of a terminal; the longest array of fixed size has 9, for a rotation


def unpack(data: bytes) -> dict[str, Any]:
    """Return envelope and body of a frame by name; what cannot be named stays a list.

    Raises ValueError if `data` is not one msgpack array.
    """
    try:
        values = msgpack.unpackb(data, strict_map_key=False)
    except Exception as error:  # msgpack raises a dozen kinds for bytes that are not msgpack
        raise ValueError(f"{len(data)} bytes that are not msgpack: {error}") from None
    if not isinstance(values, list):
        raise ValueError(f"a {type(values).__name__}, not an array")
    frame = dict(zip(Header.__struct_fields__, values, strict=False))
    row = TOPICS.get(str(frame.get("topic")))
    if row is not None and "body" in frame:
        version = frame["version"]
        body = body_type(row, version) if isinstance(version, int) else None
        frame["body"] = _named(frame["body"], body or row.body)  # a newer version has fields behind the known ones
    return frame


def _named(value: Any, body: type[msgspec.Struct]) -> Any:
    """Return `value`, as msgpack gave it, with the names of the fields of `body`."""
    if not isinstance(value, list):
        return value
    return {field.name: _item(field, item) for field, item in zip(fields(body), value, strict=False)}


def _item(field: Field, value: Any) -> Any:
    if field.form is FieldForm.ARRAY:
        return _array(value) if _is_array(value) else value
    if field.body is None or not isinstance(value, list):
        return value
    if field.form in (FieldForm.MANY, FieldForm.FIXED):
        return [_named(item, field.body) for item in value]
    return _named(value, field.body)


def _is_array(value: Any) -> bool:
    """Return whether `value` has the shape of ``[dtype, shape, bin]``; anything else is shown as it came."""
    if not isinstance(value, list) or [type(item) for item in value] != [str, list, bytes]:
        return False
    return all(isinstance(length, int) for length in value[1])


def _array(value: Any) -> Any:
    """Return ``[dtype, shape, bin]`` as nested text: all numbers where they are few, else their extent and range."""
    dtype, shape, data = value
    code = {"<f8": "d", "<f4": "f", "<i8": "q", "<i4": "i", "|i1": "b", "|u1": "B"}.get(dtype)
    count = math.prod(shape)
    if code is None or len(data) != count * struct.calcsize(code):
        return {"dtype": dtype, "shape": shape, "bytes": len(data)}
    numbers = list(struct.unpack(f"<{count}{code}", data))
    if count <= _LONG:
        return {"dtype": dtype, "shape": shape, "values": numbers}
    return {"dtype": dtype, "shape": shape, "first": numbers[:3], "min": min(numbers), "max": max(numbers)}
