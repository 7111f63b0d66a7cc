"""Repair of recordings after a killed recorder or a full disk: truncation after the last whole chunk, and indexing.

Called in a reader process, see `foreign`: a file that is to be repaired may hold anything.
Only the headers of records are read, so even a long recording is quick. The last chunk, which may be incomplete, is
read in full. The check of all checksums is separate.
"""

from __future__ import annotations

import fcntl
import os
import struct
import zlib
from array import array
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, ChunkIndex, DataEnd, Metadata, MetadataIndex, Schema
from mcap.stream_reader import get_chunk_data_stream

from trocar.services.recordings.chunks import message_indexes
from trocar.services.recordings.contents import BROKEN
from trocar.services.recordings.errors import HoleError, RecordingError, UnopenedError
from trocar.services.recordings.summary import (
    HEAD,
    MAGIC,
    RepairedRecording,
    Summary,
    attachment_index,
    finish,
    has_sound_index,
    is_closed,
    is_sound,
    messages_of,
    record_stream,
    records,
    write_at,
)

#: Start, end, uncompressed size and checksum of a chunk, before the name of its compression.
_CHUNK_HEAD = struct.Struct("<QQQII")
_CHANNEL, _BLOCK = struct.Struct("<H"), 1 << 20


def mend(path: Path, every_chunk: bool) -> RepairedRecording | None:
    """Repair the end of the recording `path` in place; return None if that is not needed. Then check `every_chunk`.

    A file without an index, or with a damaged one, gets a new one.

    Raises HoleError if a part is damaged, which is kept, with the end repaired. Raises RecordingError if it is no
    recording, is being written, or has a damaged structure; it is then unchanged.
    """
    with _opened(path) as file:
        ended = is_closed(file)
        is_whole = ended and has_sound_index(file)
        if is_whole and not every_chunk:
            return None
        scan = _scan(path, file, mend=not ended)
        if not is_whole:
            finish(file, scan.summary, scan.end, scan.checksum or 0)
            os.fsync(file)
        if every_chunk and (holes := scan.holes()):
            raise HoleError(f"{path}: {holes}")
        if is_whole:
            return None
        return RepairedRecording(scan.summary.frames, 0 if ended else max(0, scan.size - scan.end))


def _scan(path: Path, file: int, mend: bool = True) -> _Scan:
    scan = _Scan(file, os.fstat(file).st_size)
    try:
        is_recording = scan.read()
        if is_recording and scan.checksum is None and not mend:  # the structure is damaged before the end
            raise EOFError
    except BROKEN:
        raise RecordingError(f"{path}: is broken within, the record at byte {scan.end} cannot be read") from None
    if not is_recording:
        raise RecordingError(f"{path}: is not a recording (no MCAP file)")
    if mend:
        scan.mend_last_chunk()
    return scan


@contextmanager
def _opened(path: Path) -> Iterator[int]:
    try:
        file = os.open(path, os.O_RDWR | os.O_NOFOLLOW | os.O_CLOEXEC)
    except OSError as error:
        raise UnopenedError(f"{path}: {(error.strerror or str(error)).lower()}") from None
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield file
    except BlockingIOError:
        raise RecordingError(f"{path}: is being written") from None
    finally:
        os.close(file)


@dataclass(slots=True)
class _Scan:
    """A scan of a file's records, up to a truncated one.

    Attributes:
        end: End of the last whole record of the data section.
        checksum: The file's checksum up to there, 0 for unknown; None if the file is truncated.
        damaged: Names of damaged attachments.
        chunks: Chunks of the summary.
    """

    file: int
    size: int
    end: int = 0
    checksum: int | None = None
    damaged: list[str] = field(default_factory=list)
    chunks: list[ChunkIndex] = field(default_factory=list)
    summary: Summary = field(init=False)

    def __post_init__(self) -> None:
        self.summary = Summary(self.chunks)

    def read(self) -> bool:
        """Scan the file; return whether it is an MCAP file at all."""
        if os.pread(self.file, len(MAGIC), 0) != MAGIC:
            return False
        self.end = len(MAGIC)
        for opcode, start, after in records(self.file):
            if opcode == Opcode.DATA_END:
                self.checksum = DataEnd.read(record_stream(os.pread(self.file, after - start, start))).data_section_crc
            else:
                self._take_record(opcode, start, after)
                self.end = after
        return True

    def _take_record(self, opcode: int, start: int, after: int) -> None:
        """Add a record to the summary."""
        match opcode:
            case Opcode.CHUNK:
                self._take_chunk(start, after)
            case Opcode.MESSAGE_INDEX:
                self._take_message_index(start, after)
            case Opcode.SCHEMA | Opcode.CHANNEL:
                self._declare(opcode, os.pread(self.file, after - start, start))
            case Opcode.METADATA:
                record = Metadata.read(record_stream(os.pread(self.file, after - start, start)))
                self.summary.metadata.append(MetadataIndex(self.end, after - self.end, record.name))
            case Opcode.ATTACHMENT:
                content = os.pread(self.file, after - start, start)
                attachment = Attachment.read(record_stream(content))
                self.summary.attachments.append(attachment_index(attachment, self.end, after - self.end))
                self.damaged += [] if is_sound(content) else [attachment.name]

    def _take_chunk(self, start: int, after: int) -> None:
        first_ns, last_ns, size, _crc, name_length = _CHUNK_HEAD.unpack(os.pread(self.file, _CHUNK_HEAD.size, start))
        name = os.pread(self.file, min(name_length, 16), start + _CHUNK_HEAD.size).decode("ascii", "replace")
        index = ChunkIndex(
            chunk_start_offset=self.end,
            chunk_length=after - self.end,
            message_start_time=first_ns,
            message_end_time=last_ns,
            message_index_offsets={},
            message_index_length=0,
            compression=name,
            compressed_size=after - start - _CHUNK_HEAD.size - name_length - 8,
            uncompressed_size=size,
        )
        self.chunks.append(index)

    def _take_message_index(self, start: int, after: int) -> None:
        if not self.chunks:
            return
        (channel,) = _CHANNEL.unpack(os.pread(self.file, _CHANNEL.size, start))
        chunk = self.chunks[-1]
        chunk.message_index_offsets[channel] = self.end
        chunk.message_index_length += after - self.end
        if channel not in self.summary.channels:  # declared within the chunk
            self._look_into(chunk)

    def mend_last_chunk(self) -> None:
        """Index the last chunk again if its indexes are incomplete; drop it if it is truncated itself."""
        if not self.chunks:
            return
        chunk = self.chunks[-1]
        index = self._look_into(chunk)
        counts = {channel: len(entries) // 2 for channel, entries in index.items()}
        if counts and counts == messages_of(chunk):
            return
        self.checksum = 0
        self.end = chunk.chunk_start_offset + (chunk.chunk_length if counts else 0)
        if counts:
            records, chunk.message_index_offsets = message_indexes(index, self.end)
            chunk.message_index_length = len(records)
            write_at(self.file, records, self.end)
            self.end += len(records)
        else:
            self.summary.drop_last_chunk()
        self.summary.cut(chunk.chunk_start_offset)

    def holes(self) -> str:
        """Return a description of damaged parts, empty for none."""
        bad = [chunk for chunk in self.chunks if messages_of(chunk) and not self._look_into(chunk)]
        found = [f"the attachment {name!r} is damaged" for name in self.damaged]
        if bad:
            frames, began_ns = sum(sum(messages_of(chunk).values()) for chunk in bad), self.chunks[0].message_start_time
            from_s, until_s = ((ns - began_ns) * 1e-9 for ns in (bad[0].message_start_time, bad[-1].message_end_time))
            of = f"{len(bad)} of {len(self.chunks)} chunks are damaged"
            found.append(f"{of}, {frames} frames between {from_s:.3f} and {until_s:.3f} s cannot be read")
        if not found and self.checksum and self.checksum != self._checksum():
            found.append("what describes it (metadata, schemas, indexes) is damaged")
        return "; ".join(found)

    def _checksum(self) -> int:
        found = 0
        for start in range(0, self.end, _BLOCK):
            found = zlib.crc32(os.pread(self.file, min(_BLOCK, self.end - start), start), found)
        return found

    def _look_into(self, chunk: ChunkIndex) -> dict[int, array[int]]:
        """Return the message index of a chunk, empty if it is unreadable, and add its declarations to the summary."""
        data = os.pread(self.file, chunk.chunk_length - HEAD.size, chunk.chunk_start_offset + HEAD.size)
        index: dict[int, array[int]] = {}
        try:
            stream, length = get_chunk_data_stream(Chunk.read(record_stream(data)), validate_crc=True)
            while (offset := stream.count) < length:
                opcode, size = HEAD.unpack(stream.read(HEAD.size))
                record = stream.read(size)
                if opcode == Opcode.MESSAGE:
                    channel, _sequence, log_ns = struct.unpack_from("<HIQ", record)
                    index.setdefault(channel, array("Q")).extend((log_ns, offset))
                else:
                    self._declare(opcode, record)
        except BROKEN:
            return {}
        return index

    def _declare(self, opcode: int, data: bytes) -> None:
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(record_stream(data))
            self.summary.schemas.setdefault(schema.id, schema)
        elif opcode == Opcode.CHANNEL:
            channel = Channel.read(record_stream(data))
            self.summary.channels.setdefault(channel.id, channel)
