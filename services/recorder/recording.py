"""A recording on disk: written in small chunks, so that a crash loses at most the last; read back whatever is there."""

from __future__ import annotations

import struct
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader
from mcap.writer import CompressionType, Writer
from mcap_protobuf.decoder import DecoderFactory

from protocol import TOPICS, Frame
from services.recorder.schema import PACKAGE, file_descriptor
from services.recorder.transcode import to_protobuf

#: About a third of a second of a whole rig.
_CHUNK_BYTES = 128 * 1024


class RecordingWriter:
    """Writes frames to an MCAP file, with protobuf schemas inside.

    Times in the file are wall clock: the monotonic clock of the bus is mapped once, at the start, and the mapping is
    kept in the metadata, so a wall clock that steps during the recording does not matter.
    """

    def __init__(self, path: Path, metadata: Mapping[str, str]) -> None:
        self.path = path
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file: IO[bytes] = path.open("wb")
        self._writer = Writer(self._file, chunk_size=_CHUNK_BYTES, compression=CompressionType.ZSTD)
        self._writer.start(profile="", library="trocar")
        self._channels: dict[str, int] = {}
        self._to_wall_ns = time.time_ns() - time.monotonic_ns()
        self._writer.add_metadata("trocar", {**metadata, "wall_minus_monotonic_ns": str(self._to_wall_ns)})
        self.frames = 0

    def write(self, frame: Frame) -> None:
        """Append one frame."""
        sent, origin = frame.sent_ns + self._to_wall_ns, (frame.origin_ns or frame.sent_ns) + self._to_wall_ns
        self._writer.add_message(
            channel_id=self._channels.get(frame.topic) or self._channel(frame.topic),
            log_time=sent,
            data=to_protobuf(frame),
            publish_time=origin,
            sequence=frame.sequence & 0xFFFFFFFF,
        )
        self.frames += 1

    def flush(self) -> None:
        """Hand finished chunks to the system: what it has survives this process, however that ends."""
        self._file.flush()

    def _channel(self, topic: str) -> int:
        body = TOPICS[topic].body
        schema = self._writer.register_schema(
            f"{PACKAGE}.{body.__name__}", "protobuf", file_descriptor(body).SerializeToString()
        )
        self._channels[topic] = self._writer.register_channel(f"/{topic.replace('.', '/')}", "protobuf", schema)
        return self._channels[topic]

    def close(self) -> None:
        """Write the index and close the file."""
        self._writer.finish()
        self._file.close()


@dataclass(frozen=True, slots=True)
class Message:
    """One recorded frame: `body` is the protobuf message, times are wall clock."""

    topic: str
    log_time_ns: int
    body: Any


def read(path: Path) -> Iterator[Message]:
    """Yield the messages of a recording in file order; one that was cut off by a crash ends where it was cut."""
    with path.open("rb") as file:
        reader = NonSeekingReader(file, decoder_factories=[DecoderFactory()])
        try:
            for _schema, channel, message, body in reader.iter_decoded_messages(log_time_order=False):
                yield Message(channel.topic[1:].replace("/", "."), message.log_time, body)
        except (McapError, EOFError, struct.error):  # how the reader says that a record was cut
            return
