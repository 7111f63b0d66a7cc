"""Reading recordings: the bodies of the bus, in the order of sending."""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import zstandard
from google.protobuf.message import DecodeError
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Attachment, Channel, DataEnd, Message, Metadata
from mcap.stream_reader import StreamReader

from trocar.protocol import TOPICS, Frame
from trocar.services.recordings.errors import HoleError, RecordingError, UnopenedError
from trocar.services.recordings.summary import has_sound_index, is_closed, is_sound, record_stream, records
from trocar.services.recordings.transcode import to_frame

#: Exceptions of the libraries for truncated or inconsistent records.
BROKEN = (McapError, EOFError, ValueError, OverflowError, struct.error, zstandard.ZstdError, zlib.error)

_DAMAGED = "{}: is damaged; `trocar repair` says how much of it cannot be read"


@dataclass(frozen=True, slots=True)
class RecordedFrame:
    """A frame of the bus, and its wall-clock time of sending."""

    time_ns: int
    frame: Frame


def read_messages(path: Path, topics: Collection[str] = ()) -> Iterator[tuple[str, int, Any]]:
    """Yield ``(topic, time_ns, body)`` of the messages of a recording by time, as `read_frames` does.

    `body` has the same type as on the bus, so the same code works live and on files.
    """
    for each in read_frames(path, topics):
        yield each.frame.topic, each.time_ns, each.frame.body


def read_frames(path: Path, topics: Collection[str] = (), from_ns: int = 0) -> Iterator[RecordedFrame]:
    """Yield the frames of a recording by their time of sending.

    A truncated file ends after its last whole chunk. Bodies of former versions are converted to the present one.
    Raises RecordingError: one sentence, if it is no recording, or a message does not fit its topic; HoleError at a
    damaged part, after yielding the frames before it.

    Args:
        path: Path of the file.
        topics: Names of the bus topics to read; empty for all.
        from_ns: Wall-clock time of the first frame to read.
    """
    for topic, message in _messages(path, topics or TOPICS, from_ns):
        yield RecordedFrame(message.log_time, _frame(path, topic, message.data))


def read_moments(path: Path, topics: Sequence[str]) -> Iterator[tuple[Any, ...]]:
    """Yield the newest body of each topic at each message of the last topic, once there is one of each.

    Only yielded bodies are decoded, so that messages between two of the last topic cost next to nothing.
    Raises as `read_frames` does.
    """
    newest: dict[str, bytes] = {}
    for topic, message in _messages(path, topics):
        newest[topic] = message.data
        if topic == topics[-1] and len(newest) == len(set(topics)):
            yield tuple(_frame(path, name, newest[name]).body for name in topics)


def _frame(path: Path, topic: str, data: bytes) -> Frame:
    try:
        return to_frame(topic, data)
    except (ValueError, DecodeError) as error:
        raise RecordingError(f"{path}: a message of {topic} cannot be read: {error}") from None


def channel_name(topic: str) -> str:
    """Return the name of a bus topic in a file, a path for viewers."""
    return f"/{topic.replace('.', '/')}"


@contextmanager
def opened(path: Path) -> Iterator[IO[bytes]]:
    """Open a recording for reading. Raises RecordingError if there is no such file, or it is no MCAP file."""
    try:
        with path.open("rb") as file:
            if file.read(6) != b"\x89MCAP0":
                raise RecordingError(f"{path}: is not a recording (no MCAP file)")
            file.seek(0)
            yield file
    except OSError as error:
        raise UnopenedError(f"{path}: {(error.strerror or str(error)).lower()}") from None


def last_ns(path: Path, topics: Collection[str]) -> int:
    """Return the time of the last message of some topics, 0 without one; raises as `read_frames` does."""
    return max((message.log_time for _, message in _messages(path, topics)), default=0)


def _messages(path: Path, topics: Collection[str], from_ns: int = 0) -> Iterator[tuple[str, Message]]:
    """Yield topics and messages by time, using a valid index or else reading all messages first.

    Raises HoleError at a damaged part of a closed file.
    """
    wanted = {channel_name(name): name for name in topics}
    with opened(path) as file:
        closed = is_closed(file.fileno())
        try:
            if closed and has_sound_index(file.fileno()):
                reader = SeekingReader(file, validate_crcs=True)
                for _schema, channel, message in reader.iter_messages(list(wanted), starting_at=from_ns):
                    yield wanted[channel.topic], message
                return
            found: list[tuple[str, Message]] = []
            with suppress(*(() if closed else BROKEN)):
                found.extend((wanted[name], each) for name, each in _records(file) if name in wanted)
        except BROKEN:
            raise HoleError(_DAMAGED.format(path)) from None
    yield from sorted((each for each in found if each[1].log_time >= from_ns), key=lambda each: each[1].log_time)


def _records(file: IO[bytes]) -> Iterator[tuple[str, Message]]:
    channels: dict[int, str] = {}
    for record in StreamReader(file, validate_crcs=True).records:
        if isinstance(record, DataEnd):
            return
        if isinstance(record, Channel):
            channels[record.id] = record.topic
        elif isinstance(record, Message) and record.channel_id in channels:
            yield channels[record.channel_id], record


def read_extras(path: Path) -> tuple[dict[str, dict[str, str]], dict[str, bytes]]:
    """Return metadata and attachments of a recording by name, the last of two with one name.

    Raises RecordingError if it is no recording, HoleError if an attachment is damaged.
    """
    metadata: dict[str, dict[str, str]] = {}
    attachments: dict[str, bytes] = {}
    with opened(path) as file:
        number, opcode = file.fileno(), 0
        try:
            for opcode, begin, end in records(number):
                if opcode == Opcode.METADATA:
                    record = Metadata.read(record_stream(os.pread(number, end - begin, begin)))
                    metadata[record.name] = record.metadata
                elif opcode == Opcode.ATTACHMENT:
                    content = os.pread(number, end - begin, begin)
                    attachment = Attachment.read(record_stream(content))
                    if not is_sound(content):
                        raise HoleError(f"{path}: the attachment {attachment.name!r} is damaged")
                    attachments[attachment.name] = attachment.data
        except BROKEN:
            opcode = 0
        if opcode != Opcode.DATA_END and is_closed(number):
            raise HoleError(_DAMAGED.format(path))
    return metadata, attachments
