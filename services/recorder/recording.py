"""A recording on disk, written in chunks so that a crash loses at most the last one."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

from mcap.records import Attachment, Channel, Schema

from trocar.protocol import TOPICS, Frame
from trocar.services.recorder.disk import PENDING_MAX, RecordingFile
from trocar.services.recorder.losses import Loss
from trocar.services.recordings.channels import channel_name
from trocar.services.recordings.chunks import OpenChunk
from trocar.services.recordings.scene_update import SCHEMAS, descriptor
from trocar.services.recordings.schema import PACKAGE, file_descriptor
from trocar.services.recordings.transcode import to_protobuf

#: Size and age at which a chunk ends, the most that a crash loses. At 25 MB a minute a chunk of half a second has 0.2
#: MB.
CHUNK_BYTES, CHUNK_NS = 1 << 20, 500_000_000


class RecordingWriter:
    """Writes frames to an MCAP file, with protobuf schemas inside.

    Times in the file are wall clock. The monotonic clock of the bus is mapped to it once, at the start, and the mapping
    is stored in the metadata, so a wall clock that steps during the recording does no harm.

    Attributes:
        frames: Number of frames written.
        lost: Number of frames dropped because the disk is too slow, by topic.
        to_wall_ns: Offset from bus time to wall clock; in a copy of a recording, that of the original.
    """

    def __init__(
        self, path: Path, metadata: Mapping[str, str], *, shared: bool = False, to_wall_ns: int | None = None
    ) -> None:
        self.path = path
        self.frames = 0
        self.lost: Counter[str] = Counter()
        self._file = RecordingFile(path, shared=shared)
        self._channels: dict[str, int] = {}
        self.to_wall_ns = time.time_ns() - time.monotonic_ns() if to_wall_ns is None else to_wall_ns
        self._chunk = OpenChunk()
        self._chunk_began_ns = 0
        self._file.add_metadata("trocar", {**metadata, "wall_minus_monotonic_ns": str(self.to_wall_ns)})

    @property
    def pending_bytes(self) -> int:
        """Number of bytes pending for the disk."""
        return self._file.pending

    def held_s(self) -> float:
        """Return for how long the present write has been blocked by the disk, 0 for none."""
        return self._file.held_s()

    def write(self, frame: Frame) -> None:
        """Append one frame; it is dropped and counted if the disk is too far behind."""
        topic = frame.topic
        if self._file.pending > PENDING_MAX:
            self.lost[topic] += 1
            return
        sent_ns = frame.sent_ns + self.to_wall_ns
        origin_ns = frame.origin_ns + self.to_wall_ns if frame.origin_ns else sent_ns
        channel = self._channels.get(topic) or self._declare_topic(topic)
        self._add(channel, frame.sequence, sent_ns, origin_ns, to_protobuf(frame))
        self.frames += 1

    def draw(self, topic: str, sent_ns: int, data: bytes) -> None:
        """Append a drawing of a topic of `scene_update`, unless the disk is too far behind."""
        if self._file.pending > PENDING_MAX:
            return
        name = SCHEMAS[topic].DESCRIPTOR.full_name
        channel = self._channels.get(topic) or self._declare(topic, topic, name, descriptor(topic))
        self._add(channel, 0, sent_ns + self.to_wall_ns, sent_ns + self.to_wall_ns, data)

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Append a file that belongs to the recording."""
        now_ns = time.time_ns()
        self._file.add_attachment(
            Attachment(create_time=now_ns, log_time=now_ns, name=name, media_type=media_type, data=data)
        )

    def _add(self, channel: int, sequence: int, sent_ns: int, origin_ns: int, data: bytes) -> None:
        self._chunk.add(channel, sequence, sent_ns, origin_ns, data)
        if self._chunk.size > CHUNK_BYTES:
            self._end_chunk()

    def end_old_chunk(self, now_ns: int) -> None:
        """End a chunk that is old enough. Raises RecordingError if writing has failed."""
        self._file.raise_fault()
        if now_ns - self._chunk_began_ns > CHUNK_NS:
            self._end_chunk()
            self._chunk_began_ns = now_ns

    def note(self, loss: Loss) -> None:
        """Record a loss in the file's metadata."""
        self._end_chunk()
        self._file.add_metadata(
            "trocar.lost",
            {
                "topic": loss.topic,
                "frames": str(loss.frames),
                "why": loss.why,
                "from_ns": str(loss.from_ns + self.to_wall_ns),
                "until_ns": str(loss.until_ns + self.to_wall_ns),
            },
        )

    def close(self) -> None:
        """Write pending data and the index, and close the file.

        Raises RecordingError if not everything could be written; the written part is readable.
        """
        self._end_chunk()
        self._file.close()

    def _end_chunk(self) -> None:
        if self._chunk.size:
            self._file.add_chunk(self._chunk)
            self._chunk = OpenChunk()

    def _declare_topic(self, topic: str) -> int:
        body = TOPICS[topic].body
        schema = file_descriptor(body).SerializeToString()
        return self._declare(topic, channel_name(topic), f"{PACKAGE}.{body.__name__}", schema)

    def _declare(self, topic: str, channel: str, schema: str, descriptors: bytes) -> int:
        """Return the channel of a new topic, after writing its schema."""
        number = len(self._channels) + 1
        self._file.declare(Schema(number, descriptors, "protobuf", schema))
        self._file.declare(Channel(number, channel, "protobuf", {}, number))
        self._channels[topic] = number
        return number
