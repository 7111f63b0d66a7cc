"""Writing chunks of an MCAP file; the library, which writes field by field, takes five times as long a message."""

from __future__ import annotations

import struct
import zlib
from array import array
from dataclasses import dataclass, field

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Chunk, ChunkIndex

#: Opcode, length, channel, sequence, log time, publish time.
_MESSAGE = struct.Struct("<BQHIQQ")
_MESSAGE_INDEX = struct.Struct("<BQHI")
_AFTER_LENGTH = _MESSAGE.size - 9  # a record's opcode and length take nine bytes, by the specification of MCAP
#: A tenth of the library's effort for nearly the same size, as most of a frame are the low bits of doubles.
_FAST = -5


@dataclass(slots=True)
class OpenChunk:
    """A chunk being filled.

    Attributes:
        size: Number of bytes so far, before compression.
        index: By channel, log time and offset of each message, alternating as in the file's message indexes.
        level: Effort of its compression, at most 22.
    """

    size: int = 0
    index: dict[int, array[int]] = field(default_factory=dict)
    level: int = _FAST
    _records: list[bytes] = field(default_factory=list)

    def add(self, channel: int, sequence: int, log_ns: int, publish_ns: int, data: bytes) -> None:
        """Append a message."""
        entries = self.index.get(channel)
        if entries is None:
            entries = self.index[channel] = array("Q")
        entries.append(log_ns)
        entries.append(self.size)
        length = _AFTER_LENGTH + len(data)
        self._records.append(_MESSAGE.pack(Opcode.MESSAGE, length, channel, sequence & 0xFFFFFFFF, log_ns, publish_ns))
        self._records.append(data)
        self.size += 9 + length

    def close(self, offset: int) -> tuple[bytes, ChunkIndex]:
        """Return the records of the chunk, compressed, to be written at `offset`, and its entry in the summary."""
        data = b"".join(self._records)
        compressed = zstandard.ZstdCompressor(level=self.level).compress(data)
        times = [entries[::2] for entries in self.index.values()]
        chunk = Chunk(
            compression="zstd",
            data=compressed,
            message_start_time=min(map(min, times)),
            message_end_time=max(map(max, times)),
            uncompressed_crc=zlib.crc32(data),
            uncompressed_size=len(data),
        )
        builder = RecordBuilder()
        chunk.write(builder)
        record = builder.end()
        indexes, offsets = message_indexes(self.index, offset + len(record))
        return record + indexes, ChunkIndex(
            chunk_start_offset=offset,
            chunk_length=len(record),
            message_start_time=chunk.message_start_time,
            message_end_time=chunk.message_end_time,
            message_index_offsets=offsets,
            message_index_length=len(indexes),
            compression=chunk.compression,
            compressed_size=len(compressed),
            uncompressed_size=len(data),
        )


def message_indexes(index: dict[int, array[int]], offset: int) -> tuple[bytes, dict[int, int]]:
    """Return the message indexes of a chunk, to be written at `offset`, and the offset of each by channel."""
    records, offsets = b"", {}
    for channel, entries in index.items():
        offsets[channel] = offset + len(records)
        data = entries.tobytes()
        records += _MESSAGE_INDEX.pack(Opcode.MESSAGE_INDEX, 6 + len(data), channel, len(data)) + data
    return records, offsets
