"""The summary at the end of an MCAP file, for readers that seek by index; made while writing, or by a repair."""

from __future__ import annotations

import io
import itertools
import os
import struct
import tempfile
import zlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from mcap.data_stream import ReadDataStream, RecordBuilder
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
#: Opcode and length of a record; bytes of a message index before its entries; size after a stored entry.
HEAD, _INDEX_HEAD, _SIZE = struct.Struct("<BQ"), 15, struct.Struct("<I")
_FOOTER_LENGTH = 20  # by the specification of MCAP: two offsets and a checksum
#: The last record, whose last field is the checksum of the summary and of the record's other fields.
_FOOTER = struct.Struct("<BQQQI")
_TAIL = _FOOTER.size + len(MAGIC)


class StoredEntries:
    """Entries of chunks in an unnamed file in `folder`.

    An entry of 16 channels is 1.6 kB of objects, which is 11 MB an hour with two chunks a second.
    """

    def __init__(self, folder: Path) -> None:
        with tempfile.TemporaryFile(dir=folder) as file:
            self._file = os.dup(file.fileno())
        self._size = self._count = 0

    def close(self) -> None:
        """Close the file."""
        os.close(self._file)

    def append(self, chunk: ChunkIndex, /) -> None:
        """Append an entry and its size; raises OSError on a full disk."""
        record = record_bytes(chunk)
        data = record + _SIZE.pack(len(record))
        write_at(self._file, data, self._size)
        self._size += len(data)
        self._count += 1

    def pop(self) -> ChunkIndex:
        """Remove and return the last entry."""
        end = self._size - _SIZE.size
        (size,) = _SIZE.unpack(os.pread(self._file, _SIZE.size, end))
        self._size, self._count = end - size, self._count - 1
        return ChunkIndex.read(record_stream(os.pread(self._file, size, self._size)[HEAD.size :]))

    def __iter__(self) -> Iterator[ChunkIndex]:
        """Yield all entries."""
        data, start = os.pread(self._file, self._size, 0), 0
        while start < len(data):
            _opcode, length = HEAD.unpack_from(data, start)
            start += HEAD.size + length
            yield ChunkIndex.read(record_stream(data[start - length : start]))
            start += _SIZE.size

    def __len__(self) -> int:
        """Return the number of entries."""
        return self._count


@dataclass(frozen=True, slots=True)
class RepairedRecording:
    """Result of a repair.

    Attributes:
        frames: Number of frames in the file.
        cut_bytes: Size of what was cut off.
    """

    frames: int
    cut_bytes: int


@dataclass(slots=True)
class Summary:
    """The contents of a file, in the order of writing."""

    chunks: list[ChunkIndex] | StoredEntries
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    metadata: list[MetadataIndex] = field(default_factory=list)
    attachments: list[AttachmentIndex] = field(default_factory=list)

    @property
    def frames(self) -> int:
        """Number of messages in all chunks."""
        return sum(self.message_counts().values())

    def message_counts(self) -> dict[int, int]:
        """Return the number of messages by channel."""
        together: Counter[int] = Counter()
        for chunk in self.chunks:
            together.update(messages_of(chunk))
        return dict(together)

    def drop_last_chunk(self) -> ChunkIndex:
        """Remove the last chunk and everything behind it; return its entry."""
        chunk = self.chunks.pop()
        self.cut(chunk.chunk_start_offset)
        return chunk

    def cut(self, end: int) -> None:
        """Remove metadata and attachments behind `end`."""
        self.metadata = [each for each in self.metadata if each.offset < end]
        self.attachments = [each for each in self.attachments if each.offset < end]

    def end(self, offset: int, checksum: int) -> bytes:
        """Return the bytes of the file after the last chunk, which ends at `offset`.

        `checksum` is of all bytes up to there, 0 if unknown.
        """
        data_end = record_bytes(DataEnd(checksum))
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


def messages_of(chunk: ChunkIndex) -> dict[int, int]:
    """Return the number of messages by channel, from the message indexes behind the chunk, 16 bytes a message."""
    begins = sorted((offset, channel) for channel, offset in chunk.message_index_offsets.items())
    end = chunk.chunk_start_offset + chunk.chunk_length + chunk.message_index_length
    return {
        channel: (after - begin - _INDEX_HEAD) // 16
        for (begin, channel), (after, _) in itertools.pairwise([*begins, (end, 0)])
    }


def record_stream(data: bytes) -> ReadDataStream:
    """Return a stream of a record's content for the library."""
    return ReadDataStream(io.BytesIO(data))


def record_bytes(record: McapRecord) -> bytes:
    """Return the bytes of a record in the file."""
    builder = RecordBuilder()
    record.write(builder)
    data: bytes = builder.end()
    return data


def attachment_index(record: Attachment, offset: int, length: int) -> AttachmentIndex:
    """Return the summary's entry of an attachment whose record of `length` bytes is at `offset`."""
    return AttachmentIndex(
        offset, length, record.log_time, record.create_time, len(record.data), record.name, record.media_type
    )


def finish(file: int, summary: Summary, end: int, checksum: int = 0) -> None:
    """Truncate a file after its last whole group of records, at `end`, and append the summary.

    On a full disk the last chunks are dropped for it; `checksum` is of all before `end`, 0 for unknown.
    Raises OSError if not even an empty recording can be written.
    """
    while True:
        os.ftruncate(file, end)
        try:
            write_at(file, summary.end(end, checksum), end)
            return
        except OSError:
            if not summary.chunks:
                raise
            end, checksum = summary.drop_last_chunk().chunk_start_offset, 0


def write_at(file: int, data: bytes, offset: int) -> None:
    """Write all of `data` at `offset`; after a failure the file must be truncated there."""
    view = memoryview(data)
    while view:
        written = os.pwrite(file, view, offset)
        view, offset = view[written:], offset + written


def records(file: int) -> Iterator[tuple[int, int, int]]:
    """Yield opcode, begin and end of the content of each whole record, up to the DataEnd of a closed file."""
    size, end, opcode = os.fstat(file).st_size, len(MAGIC), 0
    while opcode != Opcode.DATA_END and len(head := os.pread(file, HEAD.size, end)) == HEAD.size:
        opcode, length = HEAD.unpack(head)
        begin, end = end + HEAD.size, end + HEAD.size + length
        if end > size or opcode in (Opcode.FOOTER, 0):
            return
        yield opcode, begin, end


def is_sound(content: bytes) -> bool:
    """Return whether the checksum at the end of an attachment's record is right or 0, for none."""
    return int.from_bytes(content[-4:], "little") in (0, zlib.crc32(content[:-4]))


def is_closed(file: int) -> bool:
    """Return whether a file has the end of a closed one."""
    tail = _tail(file)
    return len(tail) == _TAIL and tail[0] == Opcode.FOOTER and tail.endswith(MAGIC)


def has_sound_index(file: int) -> bool:
    """Return whether the checksum of the summary of a closed file is right or 0, for none."""
    tail = _tail(file)
    *_, start, _offsets_start, checksum = _FOOTER.unpack_from(tail)
    end = os.fstat(file).st_size - _TAIL
    if not 0 < start <= end:
        return False
    index = os.pread(file, end - start, start)
    return checksum in (0, zlib.crc32(tail[: _FOOTER.size - 4], zlib.crc32(index)))


def _tail(file: int) -> bytes:
    return os.pread(file, _TAIL, max(0, os.fstat(file).st_size - _TAIL))
