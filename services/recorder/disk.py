"""The file of a recording, written by a thread of its own so that a slow disk blocks nothing else, and ended in good
order whatever happens, even on a full disk.
"""

from __future__ import annotations

import errno
import fcntl
import os
import shutil
import threading
import time
import zlib
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from queue import SimpleQueue

from mcap.records import Attachment, Channel, Header, Metadata, MetadataIndex, Schema

from trocar.services.recordings.chunks import OpenChunk
from trocar.services.recordings.errors import RecordingError
from trocar.services.recordings.place import fault_of_folder
from trocar.services.recordings.summary import (
    MAGIC,
    StoredEntries,
    Summary,
    attachment_index,
    finish,
    record_bytes,
    write_at,
)

#: Most bytes pending for the disk, about a quarter of a minute of a whole rig at full rate.
PENDING_MAX = 128 << 20
#: Without so much room no file is begun, as it would stay nearly empty: a few seconds with what explains them.
FREE_MIN = 16 << 20


class RecordingFile:
    """An MCAP file being written. One thread queues data, another compresses and writes.

    Raises RecordingError if the file cannot be made.

    Args:
        path: Path of a file that does not exist yet.
        shared: Whether other users may read it and its folder, as far as the umask permits; else only this user may.
    """

    def __init__(self, path: Path, *, shared: bool = False) -> None:
        self.path = path
        self._handed_over = 0  # by the one thread
        self._done = 0  # by the other
        self._end = self._checksum = 0  # end of the last complete group of records, and checksum up to it
        self._error: OSError | None = None
        self._queue: SimpleQueue[tuple[int, Callable[[], None]] | None] = SimpleQueue()
        try:
            if fault := fault_of_folder(path.parent, shared=shared):
                raise RecordingError(f"{path}: cannot be written: {fault}")
            path.parent.mkdir(parents=True, exist_ok=True)
            free = shutil.disk_usage(path.parent).free
            if free < FREE_MIN:
                told = f"{os.strerror(errno.ENOSPC).lower()}: {free >> 20} MB are free, {FREE_MIN >> 20} MB are needed"
                raise RecordingError(f"{path}: cannot be written: {told}")
            flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
            self._file = os.open(path, flags, 0o666 if shared else 0o600)
            fcntl.flock(self._file, fcntl.LOCK_EX)  # prevents repairs while it is being written
            try:
                self._append(MAGIC + record_bytes(Header("", "trocar")))
                self._entries = StoredEntries(path.parent)
            except OSError:
                os.close(self._file)
                path.unlink()
                raise
        except OSError as error:
            raise RecordingError(f"{path}: cannot be written: {_why(error)}") from None
        self._summary = Summary(self._entries)
        self._write: _Write | None = None  # in progress
        self._thread = threading.Thread(target=self._run, name="disk", daemon=True)
        self._thread.start()

    def declare(self, record: Schema | Channel) -> None:
        """Append a schema or a channel; call this before the first chunk with a message of it."""
        self._hand_over(0, lambda: self._declare(record))

    def add_metadata(self, name: str, data: dict[str, str]) -> None:
        """Append a metadata record."""
        self._hand_over(0, lambda: self._write_metadata(Metadata(name, data)))

    def add_attachment(self, record: Attachment) -> None:
        """Append a file that belongs to the recording."""
        self._hand_over(len(record.data), lambda: self._write_attachment(record))

    def add_chunk(self, chunk: OpenChunk) -> None:
        """Append a chunk, which must not be filled any further."""
        self._hand_over(chunk.size, lambda: self._write_chunk(chunk))

    def raise_fault(self) -> None:
        """Raise RecordingError if queued data could not be written."""
        if self._error is not None:
            raise RecordingError(f"{self.path}: {_why(self._error)}")

    def close(self) -> None:
        """Write what is pending and the index, and close.

        Raises RecordingError if not everything could be written; the written part is readable.
        """
        self._queue.put(None)
        self._thread.join()
        with closing(self._entries):
            try:
                finish(self._file, self._summary, self._end, self._checksum)
            except OSError as error:
                self._error = self._error or error
            finally:
                os.close(self._file)
            if self._error is not None:
                raise RecordingError(f"{self.path}: {_why(self._error)}; {self._summary.frames} frames were kept")

    @property
    def pending(self) -> int:
        """Number of bytes queued and neither written nor given up yet."""
        return self._handed_over - self._done

    def held_s(self) -> float:
        """Return for how long the present write has been blocked by the disk, 0 for none.

        Time in which the writing thread waits for a processor is not counted.
        """
        write = self._write
        return 0.0 if write is None else write.held_s()

    def _hand_over(self, size: int, write: Callable[[], None]) -> None:
        self._handed_over += size
        self._queue.put((size, write))

    def _run(self) -> None:
        """Write queued data; stop at the first error, as the file would have a gap."""
        while (task := self._queue.get()) is not None:
            size, write = task
            try:
                if self._error is None:
                    write()
            except OSError as error:
                self._error = error
            self._done += size

    def _declare(self, record: Schema | Channel) -> None:
        self._append(record_bytes(record))
        if isinstance(record, Schema):
            self._summary.schemas[record.id] = record
        else:
            self._summary.channels[record.id] = record

    def _write_metadata(self, record: Metadata) -> None:
        data = record_bytes(record)
        index = MetadataIndex(self._end, len(data), record.name)
        self._append(data, lambda: self._summary.metadata.append(index))

    def _write_attachment(self, record: Attachment) -> None:
        data = record_bytes(record)
        index = attachment_index(record, self._end, len(data))
        self._append(data, lambda: self._summary.attachments.append(index))

    def _write_chunk(self, chunk: OpenChunk) -> None:
        data, index = chunk.close(self._end)
        self._append(data, lambda: self._summary.chunks.append(index))

    def _append(self, data: bytes, index: Callable[[], None] = lambda: None) -> None:
        """Write `data`, and then its index; the file ends before a group of which either is missing."""
        self._write = _Write()
        try:
            write_at(self._file, data, self._end)
            index()
        finally:
            self._write = None
        self._end += len(data)
        self._checksum = zlib.crc32(data, self._checksum)


class _Write:
    """A write of the calling thread that starts now."""

    def __init__(self) -> None:
        self._task = Path(f"/proc/self/task/{threading.get_native_id()}")
        self._waited_s = self._wait_s()
        self._began_s = time.monotonic()

    def held_s(self) -> float:
        """Return its duration less the time in which its thread waited for a processor; 0 while it waits."""
        try:
            state = (self._task / "stat").read_bytes().rpartition(b")")[2].split(maxsplit=1)[0]
        except OSError:
            return 0.0
        if state == b"R":
            return 0.0
        return time.monotonic() - self._began_s - (self._wait_s() - self._waited_s)

    def _wait_s(self) -> float:
        """Return for how long the thread has waited for a processor, 0 if the kernel does not report it."""
        try:
            return int((self._task / "schedstat").read_bytes().split()[1]) * 1e-9
        except OSError:
            return 0.0


def _why(error: OSError) -> str:
    return (error.strerror or str(error)).lower()
