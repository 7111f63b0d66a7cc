"""The end of an MCAP file: what readers that seek by index look at first. Made while writing, or from a torn file."""

from __future__ import annotations

import os
import struct
import zlib
from collections import Counter
from dataclasses import dataclass, field

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    McapRecord,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

MAGIC = b"\x89MCAP0\r\n"
_FOOTER_LENGTH = 20
#: The last record, whose last field is the checksum of the index and of what comes before it in the record.
_FOOTER = struct.Struct("<BQQQI")
_TAIL = _FOOTER.size + len(MAGIC)


@dataclass(slots=True)
class Summary:
    """What a file holds, in the order in which it was written."""

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    chunks: list[ChunkIndex] = field(default_factory=list)
    metadata: list[MetadataIndex] = field(default_factory=list)
    attachments: list[AttachmentIndex] = field(default_factory=list)
    counts: list[dict[int, int]] = field(default_factory=list)  # of each chunk: messages by channel

    @property
    def frames(self) -> int:
        """Messages in all chunks."""
        return sum(self.message_counts().values())

    def message_counts(self) -> dict[int, int]:
        """Return the number of messages by channel."""
        together: Counter[int] = Counter()
        for chunk in self.counts:
            together.update(chunk)
        return dict(together)

    def drop_last_chunk(self) -> ChunkIndex:
        """Forget the last chunk, what was counted of it, and what lies behind it; return its entry."""
        chunk = self.chunks.pop()
        self.counts.pop()
        self.cut(chunk.chunk_start_offset)
        return chunk

    def cut(self, end: int) -> None:
        """Forget metadata and attachments that lie behind `end`."""
        self.metadata = [each for each in self.metadata if each.offset < end]
        self.attachments = [each for each in self.attachments if each.offset < end]

    def end(self, offset: int) -> bytes:
        """Return everything that follows the last chunk, which ends at `offset`, to the last byte of the file."""
        data_end = record_bytes(DataEnd(0))
        start = offset + len(data_end)
        data, offsets = b"", []
        groups: list[tuple[Opcode, list[McapRecord]]] = [
            (Opcode.SCHEMA, list(self.schemas.values())),
            (Opcode.CHANNEL, list(self.channels.values())),
            (Opcode.STATISTICS, [self._statistics()]),
            (Opcode.CHUNK_INDEX, list(self.chunks)),
            (Opcode.ATTACHMENT_INDEX, list(self.attachments)),
            (Opcode.METADATA_INDEX, list(self.metadata)),
        ]
        for opcode, records in groups:
            group = b"".join(map(record_bytes, records))
            if group:
                offsets.append(SummaryOffset(opcode, start + len(data), len(group)))
            data += group
        offsets_start = start + len(data)
        data += b"".join(map(record_bytes, offsets))
        head = struct.pack("<BQQQ", Opcode.FOOTER, _FOOTER_LENGTH, start, offsets_start)
        footer = Footer(start, offsets_start, zlib.crc32(head, zlib.crc32(data)))
        return data_end + data + record_bytes(footer) + MAGIC

    def _statistics(self) -> Statistics:
        counts = self.message_counts()
        return Statistics(
            attachment_count=len(self.attachments),
            channel_count=len(self.channels),
            channel_message_counts=counts,
            chunk_count=len(self.chunks),
            message_count=sum(counts.values()),
            message_start_time=min((chunk.message_start_time for chunk in self.chunks), default=0),
            message_end_time=max((chunk.message_end_time for chunk in self.chunks), default=0),
            metadata_count=len(self.metadata),
            schema_count=len(self.schemas),
        )


def record_bytes(record: McapRecord) -> bytes:
    """Return a record as it stands in the file."""
    builder = RecordBuilder()
    record.write(builder)
    data: bytes = builder.end()
    return data


def attachment_index(record: Attachment, offset: int, length: int) -> AttachmentIndex:
    """Return the entry in the summary of an attachment whose record of `length` bytes is at `offset`."""
    return AttachmentIndex(
        offset, length, record.log_time, record.create_time, len(record.data), record.name, record.media_type
    )


def finish(file: int, summary: Summary, end: int) -> None:
    """Cut a file after its last whole group of records, at `end`, and append the summary.

    Where there is no room for it, the last chunks make room.
    Raises OSError if not even an empty recording can be written.
    """
    while True:
        os.ftruncate(file, end)
        try:
            write_at(file, summary.end(end), end)
            return
        except OSError:
            if not summary.chunks:
                raise
            end = summary.drop_last_chunk().chunk_start_offset


def write_at(file: int, data: bytes, offset: int) -> None:
    """Write all of `data` at `offset`; what was written of it when that fails is to be cut off."""
    view = memoryview(data)
    while view:
        written = os.pwrite(file, view, offset)
        view, offset = view[written:], offset + written


def is_closed(file: int) -> bool:
    """Return whether a file ends as one does that was closed."""
    tail = _tail(file)
    return len(tail) == _TAIL and tail[0] == Opcode.FOOTER and tail.endswith(MAGIC)


def has_sound_index(file: int) -> bool:
    """Return whether the index at the end of a closed file is what was written there; 0 stands for no checksum."""
    tail = _tail(file)
    *_, start, _offsets_start, checksum = _FOOTER.unpack_from(tail)
    end = os.fstat(file).st_size - _TAIL
    if not 0 < start <= end:
        return False
    index = os.pread(file, end - start, start)
    return checksum in (0, zlib.crc32(tail[: _FOOTER.size - 4], zlib.crc32(index)))


def _tail(file: int) -> bytes:
    return os.pread(file, _TAIL, max(0, os.fstat(file).st_size - _TAIL))
