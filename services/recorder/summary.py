"""The end of an MCAP file: what readers that seek by index look at first. Made while writing, or from a torn file."""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from dataclasses import dataclass, field

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
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


@dataclass(slots=True)
class Summary:
    """What a file holds, in the order in which it was written."""

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    chunks: list[ChunkIndex] = field(default_factory=list)
    metadata: list[MetadataIndex] = field(default_factory=list)
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
        """Forget the last chunk, what was counted of it, and metadata that lies behind it; return its entry."""
        chunk = self.chunks.pop()
        self.counts.pop()
        self.metadata = [each for each in self.metadata if each.offset < chunk.chunk_start_offset]
        return chunk

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
            attachment_count=0,
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
