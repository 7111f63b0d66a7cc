"""Recordings read back: the bodies of the bus, in the order in which they were sent."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from typing import IO, Any

import zstandard
from google.protobuf.message import DecodeError
from mcap.exceptions import McapError
from mcap.reader import SeekingReader
from mcap.records import Attachment, Channel, Message, Metadata
from mcap.stream_reader import StreamReader

from protocol import TOPICS, Frame
from services.recordings.errors import RecordingError
from services.recordings.transcode import to_frame

#: What the libraries raise for a record that is cut, or does not hold what it says.
BROKEN = (McapError, EOFError, ValueError, OverflowError, struct.error, zstandard.ZstdError, zlib.error)


@dataclass(frozen=True, slots=True)
class RecordedFrame:
    """A frame of the bus, and the wall-clock time at which it was sent."""

    time_ns: int
    frame: Frame


def read_messages(path: Path, topics: Collection[str] = ()) -> Iterator[tuple[str, int, Any]]:
    """Yield ``(topic, time_ns, body)`` of the messages of a recording by time, as `read_frames` does.

    `body` is the same type as on the bus, so what computes with it works live and on a file.
    """
    for each in read_frames(path, topics):
        yield each.frame.topic, each.time_ns, each.frame.body


def read_frames(path: Path, topics: Collection[str] = (), from_ns: int = 0) -> Iterator[RecordedFrame]:
    """Yield the frames of a recording by the time at which they were sent.

    A file that was cut ends after its last whole chunk. Bodies of former versions are lifted to today's.
    Raises RecordingError: one sentence, if it is no recording, or holds a message that is not what its topic declares.

    Args:
        path: Of the file.
        topics: Names of bus topics that are wanted; all of them where it is empty.
        from_ns: Wall-clock time before which nothing is wanted.
    """
    wanted = {channel_name(name): name for name in topics or TOPICS}
    with opened(path) as file:
        for channel, message in _messages(file, wanted, from_ns):
            yield RecordedFrame(message.log_time, _frame(path, wanted[channel.topic], message.data))


def read_moments(path: Path, topics: Sequence[str]) -> Iterator[tuple[Any, ...]]:
    """Yield the newest body of each topic at each message of the last one, from where there is one of each.

    Only what is seen then is decoded: reading devices that spoke between two states costs next to nothing.
    Raises as `read_frames` does.
    """
    wanted = {channel_name(name): name for name in topics}
    newest: dict[str, bytes] = {}
    with opened(path) as file:
        for channel, message in _messages(file, wanted):
            newest[wanted[channel.topic]] = message.data
            if wanted[channel.topic] == topics[-1] and len(newest) == len(wanted):
                yield tuple(_frame(path, name, newest[name]).body for name in topics)


def _frame(path: Path, topic: str, data: bytes) -> Frame:
    try:
        return to_frame(topic, data)
    except (ValueError, DecodeError) as error:
        raise RecordingError(f"{path}: a message of {topic} cannot be read: {error}") from None


def channel_name(topic: str) -> str:
    """Return what a topic of the bus is called in a file: viewers want paths."""
    return f"/{topic.replace('.', '/')}"


@contextmanager
def opened(path: Path) -> Iterator[IO[bytes]]:
    """Open a recording to be read. Raises RecordingError if there is no such file, or it is no MCAP file."""
    try:
        with path.open("rb") as file:
            if file.read(6) != b"\x89MCAP0":
                raise RecordingError(f"{path}: is not a recording (no MCAP file)")
            file.seek(0)
            yield file
    except OSError as error:
        raise RecordingError(f"{path}: {(error.strerror or str(error)).lower()}") from None


def last_ns(path: Path, topics: Collection[str]) -> int:
    """Return the time of the last message of some topics, 0 where there is none; raises as `read_frames` does."""
    with opened(path) as file:
        return max((each.log_time for _, each in _messages(file, [channel_name(name) for name in topics])), default=0)


def _messages(file: IO[bytes], wanted: Collection[str], from_ns: int = 0) -> Iterator[tuple[Channel, Message]]:
    """Yield messages by time: by the index where the file was closed, else all are read first."""
    reader = SeekingReader(file)
    try:
        is_whole = reader.get_summary() is not None
    except BROKEN:
        is_whole = False
    if is_whole:
        for _schema, channel, message in reader.iter_messages(list(wanted), starting_at=from_ns):
            yield channel, message
        return
    file.seek(0)
    found = [(channel, message) for channel, message in _whole_records(file) if channel.topic in wanted]
    by_time = attrgetter("log_time")
    yield from sorted((each for each in found if each[1].log_time >= from_ns), key=lambda each: by_time(each[1]))


def _whole_records(file: IO[bytes]) -> Iterator[tuple[Channel, Message]]:
    channels: dict[int, Channel] = {}
    try:
        for record in StreamReader(file).records:
            if isinstance(record, Channel):
                channels[record.id] = record
            elif isinstance(record, Message) and record.channel_id in channels:
                yield channels[record.channel_id], record
    except BROKEN:
        return


def read_extras(path: Path) -> tuple[dict[str, dict[str, str]], dict[str, bytes]]:
    """Return metadata and attachments of a recording by name; of two with one name the last.

    Raises RecordingError if it is no recording.
    """
    metadata: dict[str, dict[str, str]] = {}
    attachments: dict[str, bytes] = {}
    with opened(path) as file, suppress(*BROKEN):
        for record in StreamReader(file, emit_chunks=True).records:
            if isinstance(record, Metadata):
                metadata[record.name] = record.metadata
            elif isinstance(record, Attachment):
                attachments[record.name] = record.data
    return metadata, attachments
