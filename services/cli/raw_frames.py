"""Frames as any language would read them: plain msgpack, names and dtypes from the declared bodies."""

from __future__ import annotations

import math
import struct
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

import msgpack
import msgspec

from protocol.arrays import Array
from protocol.frame import Header
from protocol.topics import TOPICS

_LONG = 12


def unpack(data: bytes) -> dict[str, Any]:
    """Return envelope and body of a frame by name; what cannot be named stays a list.

    Raises
    ------
    ValueError
        if `data` is not one msgpack array.
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
        frame["body"] = _named(frame["body"], row.body)
    return frame


def _named(value: Any, kind: Any) -> Any:
    """Return `value`, as msgpack gave it, with the field names of the declared type `kind`."""
    if not isinstance(value, list):
        return value
    if kind is Array:
        return _array(value)
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        hints = get_type_hints(kind)
        names = kind.__struct_fields__
        return {name: _named(item, hints[name]) for name, item in zip(names, value, strict=False)}
    if get_origin(kind) is tuple:
        return [_named(item, get_args(kind)[0]) for item in value]
    if get_origin(kind) in (Union, UnionType):
        return _named(value, next(k for k in get_args(kind) if k is not NoneType))
    return value


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
