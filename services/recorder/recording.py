"""A recording on disk: written in chunks, so that a crash loses at most the last; read back whatever is there."""

from __future__ import annotations

import struct
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader
from mcap.records import Channel, Schema
from mcap_protobuf.decoder import DecoderFactory

from protocol import TOPICS, Frame
from services.recorder.chunks import OpenChunk
from services.recorder.disk import PENDING_MAX, RecordingFile
from services.recorder.losses import Loss
from services.recorder.schema import PACKAGE, file_descriptor
from services.recorder.transcode import to_protobuf

#: A chunk ends when it is this large or this old: what a crash takes with it.
CHUNK_BYTES = 1 << 20
CHUNK_NS = 500_000_000


class RecordingWriter:
    """Writes frames to an MCAP file, with protobuf schemas inside.

    Times in the file are wall clock: the monotonic clock of the bus is mapped once, at the start, and the mapping is
    kept in the metadata, so a wall clock that steps during the recording does not matter.

    Attributes
    ----------
    frames
        Frames taken.
    lost
        Frames not taken because the disk is too slow, by topic.
    """

    def __init__(self, path: Path, metadata: Mapping[str, str], *, shared: bool = False) -> None:
        self.path = path
        self.frames = 0
        self.lost: Counter[str] = Counter()
        self._file = RecordingFile(path, shared=shared)
        self._channels: dict[str, int] = {}
        self._to_wall_ns = time.time_ns() - time.monotonic_ns()
        self._chunk = OpenChunk()
        self._chunk_began_ns = 0
        self._file.add_metadata("trocar", {**metadata, "wall_minus_monotonic_ns": str(self._to_wall_ns)})

    @property
    def pending_bytes(self) -> int:
        """Bytes that wait for the disk."""
        return self._file.pending

    def held_s(self) -> float:
        """Return for how long the disk has held the write that goes on, 0 for none."""
        return self._file.held_s()

    def write(self, frame: Frame) -> None:
        """Append one frame; one that comes while the disk is far behind is lost, and counted."""
        topic = frame.topic
        if self._file.pending > PENDING_MAX:
            self.lost[topic] += 1
            return
        sent_ns = frame.sent_ns + self._to_wall_ns
        origin_ns = frame.origin_ns + self._to_wall_ns if frame.origin_ns else sent_ns
        channel = self._channels.get(topic) or self._declare(topic)
        self._chunk.add(channel, frame.sequence, sent_ns, origin_ns, to_protobuf(frame))
        self.frames += 1
        if self._chunk.size > CHUNK_BYTES:
            self._end_chunk()

    def turn(self, now_ns: int) -> None:
        """End a chunk that is old enough.

        Raises
        ------
        RecordingError
            if the disk does not take what is written.
        """
        self._file.check()
        if now_ns - self._chunk_began_ns > CHUNK_NS:
            self._end_chunk()
            self._chunk_began_ns = now_ns

    def note(self, loss: Loss) -> None:
        """Say in the file what is missing in it."""
        self._end_chunk()
        self._file.add_metadata(
            "trocar.lost",
            {
                "topic": loss.topic,
                "frames": str(loss.frames),
                "why": loss.why,
                "from_ns": str(loss.from_ns + self._to_wall_ns),
                "until_ns": str(loss.until_ns + self._to_wall_ns),
            },
        )

    def close(self) -> None:
        """Write what is left and the index, and close the file.

        Raises
        ------
        RecordingError
            if not everything could be written: what was is there, and readable.
        """
        self._end_chunk()
        self._file.close()

    def _end_chunk(self) -> None:
        if self._chunk.size:
            self._file.add_chunk(self._chunk)
            self._chunk = OpenChunk()

    def _declare(self, topic: str) -> int:
        """Number a topic, and write what its messages are."""
        body, number = TOPICS[topic].body, len(self._channels) + 1
        descriptor = file_descriptor(body).SerializeToString()
        self._file.declare(Schema(number, descriptor, "protobuf", f"{PACKAGE}.{body.__name__}"))
        self._file.declare(Channel(number, f"/{topic.replace('.', '/')}", "protobuf", {}, number))
        self._channels[topic] = number
        return number


@dataclass(frozen=True, slots=True)
class RecordedMessage:
    """One recorded frame: `body` is the protobuf message, times are wall clock."""

    topic: str
    log_time_ns: int
    body: Any


def read(path: Path) -> Iterator[RecordedMessage]:
    """Yield the messages of a recording in file order; one that was cut off by a crash ends where it was cut."""
    with path.open("rb") as file:
        reader = NonSeekingReader(file, decoder_factories=[DecoderFactory()])
        try:
            for _schema, channel, message, body in reader.iter_decoded_messages(log_time_order=False):
                yield RecordedMessage(channel.topic[1:].replace("/", "."), message.log_time, body)
        except (McapError, EOFError, struct.error):  # how the reader says that a record was cut
            return
