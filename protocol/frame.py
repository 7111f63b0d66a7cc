"""The envelope: bytes to frames and back. Everything that arrives is checked here; what fails has a named reason."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Any, Literal, get_type_hints

import msgspec
from msgspec import Meta

from trocar.protocol import declared, soundness, upgrades
from trocar.protocol.topics import TOPICS, Topic

#: Major version of the envelope itself: a frame with another one is refused unread. It has not changed since the first.
PROTOCOL_VERSION = 1
#: No frame of the rig comes near this; what is larger is refused before it is parsed, as it may be endless.
MAX_FRAME_BYTES = 1 << 20


class Reason(StrEnum):
    """Why a frame was refused. The bus counts them by name."""

    TOO_LARGE = "too_large"
    MALFORMED = "malformed"
    PROTOCOL_VERSION = "protocol_version"
    UNKNOWN_TOPIC = "unknown_topic"
    WRONG_TOPIC = "wrong_topic"
    NEWER_VERSION = "newer_version"
    UNKNOWN_VERSION = "unknown_version"
    BODY = "body"
    ARRAY_DTYPE = "array_dtype"
    ARRAY_SHAPE = "array_shape"
    NOT_FINITE = "not_finite"
    OUT_OF_ORDER = "out_of_order"
    OLD_INCARNATION = "old_incarnation"
    FLOOD = "flood"


class FrameError(ValueError):
    """A frame that is refused: `reason` for counting, the message for a person."""

    def __init__(self, reason: Reason, detail: str) -> None:
        super().__init__(f"{reason}: {detail}")
        self.reason = reason


class Header(msgspec.Struct, array_like=True, frozen=True, gc=False):
    """What every frame begins with; the body follows, unread."""

    protocol: Annotated[int, Meta(description="PROTOCOL_VERSION of the sender")]
    topic: Annotated[str, Meta(max_length=64)]
    version: Annotated[int, Meta(ge=1, lt=1 << 16, description="version of the body")]
    incarnation: Annotated[int, Meta(ge=0, description="random per start of the publisher")]
    sequence: Annotated[int, Meta(ge=0, description="per topic and incarnation, from 0")]
    sent_ns: Annotated[int, Meta(ge=0, description="monotonic clock of the sender's host")]
    origin_ns: Annotated[int, Meta(ge=0, description="monotonic time of the device sample answered, 0 none")]
    valid: Annotated[bool, Meta(description="false: some input of the sender was stale")]
    body: msgspec.Raw


class Frame(msgspec.Struct, array_like=True, frozen=True):
    """A frame as its reader gets it: the envelope and a checked body of the current version."""

    protocol: int
    topic: str
    version: int
    incarnation: int
    sequence: int
    sent_ns: int
    origin_ns: int
    valid: bool
    body: Any


_encoder = msgspec.msgpack.Encoder()
_header = msgspec.msgpack.Decoder(Header)


def encode(frame: Frame) -> bytes:
    """Return the bytes of `frame`: one msgpack array, envelope first, body last."""
    return _encoder.encode(frame)


def peek(data: bytes) -> Header:
    """Return the envelope of `data` with the body unread: for recorders and sniffers.

    Raises FrameError if `data` is too large, is not a frame, or has another protocol version.
    """
    if len(data) > MAX_FRAME_BYTES:
        raise FrameError(Reason.TOO_LARGE, f"{len(data)} bytes, at most {MAX_FRAME_BYTES}")
    try:
        header = _header.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError, OverflowError) as error:
        raise FrameError(Reason.MALFORMED, str(error)) from None
    if header.protocol != PROTOCOL_VERSION:
        raise FrameError(Reason.PROTOCOL_VERSION, f"protocol {header.protocol}, this is {PROTOCOL_VERSION}")
    return header


def decode(data: bytes, expected: str | None = None, *, used: bool = True) -> Frame:
    """Return the frame in `data`, its body checked and lifted to the current version.

    Raises FrameError with the named reason, for anything that is not exactly a valid frame.

    Args:
        data: One message of the bus.
        expected: The topic of the socket that it came from; any known topic where None.
        used: Whether the reader acts or computes with it. For one who only keeps it, numbers that are none are a
            finding and not a fault.
    """
    frame = None if expected is None else _straight(expected, data, used)
    return _look_into(data, expected, used=used) if frame is None else frame


def _straight(name: str, data: bytes, used: bool) -> Frame | None:
    """Return the frame in `data` if it is one of topic `name` as this process would send it: nearly every frame is.

    One pass over the bytes; whatever is not exactly that gets None, and `_look_into` says what it is.
    """
    row, known = TOPICS.get(name), _KNOWN.get((name, used))
    if row is None or len(data) > MAX_FRAME_BYTES:
        return None
    if known is None or known[0] is not row:
        sound = soundness.check(row.body, finite_scalars=row.command and used, finite_arrays=used)
        known = _KNOWN[name, used] = row, _one_pass_decoder(row), sound
    try:
        head = known[1].decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError, OverflowError):
        return None
    body = head.body
    if not known[2](body):
        return None
    return Frame(
        PROTOCOL_VERSION, name, head.version, head.incarnation, head.sequence,
        head.sent_ns, head.origin_ns, head.valid, body,
    )  # fmt: skip


def _one_pass_decoder(row: Topic) -> msgspec.msgpack.Decoder[Any]:
    """Return what decodes envelope and body together, of one topic and version only."""
    exact: dict[str, Any] = {
        "protocol": Literal[PROTOCOL_VERSION],
        "topic": Literal[row.name],
        "version": Literal[row.version],
        "body": row.body,
    }
    declared_types = get_type_hints(Header, include_extras=True)
    head = [(name, exact.get(name, declared_types[name])) for name in Header.__struct_fields__]
    kind = msgspec.defstruct(f"{row.body.__name__}Frame", head, array_like=True, frozen=True, gc=False)
    return msgspec.msgpack.Decoder(kind)


#: By topic, and whether frames are used: its row, and what decodes and checks its frames.
_KNOWN: dict[tuple[str, bool], tuple[Topic, msgspec.msgpack.Decoder[Any], soundness.Check]] = {}


def _look_into(data: bytes, expected: str | None, *, used: bool) -> Frame:
    header = peek(data)
    row = TOPICS.get(header.topic)
    if row is None:
        raise FrameError(Reason.UNKNOWN_TOPIC, f"no topic {header.topic!r}")
    if expected is not None and header.topic != expected:
        raise FrameError(Reason.WRONG_TOPIC, f"{header.topic!r} on the socket of {expected!r}")
    body = _decode_body(row, header, used=used)
    return Frame(
        header.protocol, header.topic, row.version, header.incarnation, header.sequence,
        header.sent_ns, header.origin_ns, header.valid, body,
    )  # fmt: skip


def _decode_body(row: Topic, header: Header, *, used: bool) -> Any:
    if header.version > row.version:
        raise FrameError(Reason.NEWER_VERSION, f"{row.name} version {header.version}, this knows {row.version}")
    kind = upgrades.body_type(row, header.version)
    if kind is None:
        raise FrameError(Reason.UNKNOWN_VERSION, f"{row.name} version {header.version} is no longer known")
    try:
        body = declared.decoder(kind).decode(header.body)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError, OverflowError) as error:
        raise FrameError(Reason.BODY, f"{row.name}: {error}") from None
    finite_scalars = row.command and used
    if not soundness.check(kind, finite_scalars=finite_scalars, finite_arrays=used)(body):
        fault = declared.fault(body, finite_scalars=finite_scalars)
        if fault is not None:
            raise FrameError(Reason(fault[0]), f"{row.name}: {fault[1]}")
    return upgrades.lift(row, header.version, body)
