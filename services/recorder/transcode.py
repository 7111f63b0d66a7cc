"""Frames of the bus to protobuf bytes."""

from __future__ import annotations

from typing import Any

import msgspec

from protocol import Frame
from protocol.arrays import Array
from services.recorder.schema import message_class


def to_protobuf(frame: Frame) -> bytes:
    """Return body and envelope of `frame` as the protobuf message of its topic."""
    body: msgspec.Struct = frame.body
    message = message_class(type(body))(**_fields(body))
    envelope: Any = message.envelope
    envelope.version, envelope.incarnation, envelope.sequence = frame.version, frame.incarnation, frame.sequence
    envelope.sent_ns, envelope.origin_ns, envelope.valid = frame.sent_ns, frame.origin_ns, frame.valid
    data: bytes = message.SerializeToString()
    return data


def _fields(body: msgspec.Struct) -> dict[str, Any]:
    return {name: _value(getattr(body, name)) for name in body.__struct_fields__}


def _value(value: Any) -> Any:
    if isinstance(value, Array):
        return value.view().ravel().tolist()
    if isinstance(value, msgspec.Struct):
        return _fields(value)
    if isinstance(value, tuple) and value and isinstance(value[0], msgspec.Struct):
        return [_fields(item) for item in value]
    return value
