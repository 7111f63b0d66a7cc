"""Repair of recordings after a killed recorder or a full disk, by another process: a torn file may hold anything."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import msgspec

from trocar.services.foreign_files import Refusal, ask
from trocar.services.recordings.errors import RecordingError
from trocar.services.recordings.reader import told
from trocar.services.recordings.summary import RepairedRecording, is_closed

_MODULE = "trocar.services.recordings.foreign"
#: Of a reader that a recorder waits for beside its work.
_NICE = 10


_result = msgspec.json.Decoder(RepairedRecording | None)


def repair(path: Path, every_chunk: bool = True, nice: int = 0) -> RepairedRecording | None:
    """Repair the end of the recording `path` in place; return None if that is not needed. Then check `every_chunk`.

    A file without an index, or with a damaged one, gets a new one.

    Raises HoleError if a part is damaged, which is kept, with the end repaired. Raises RecordingError if it is no
    recording, is being written, or has a damaged structure; it is then unchanged.
    """
    with told(path), closing(ask(_MODULE, "repair", path, nice=nice, every_chunk=every_chunk)) as answer:
        (message,) = answer
        done: RepairedRecording | None = _result.decode(message)
        return done


def repair_all(directory: Path) -> Iterator[tuple[Path, RepairedRecording | Refusal]]:
    """Repair all recordings of this user in `directory` that have no end and are not being written.

    Yields those that were repaired, and those that cannot be read within limits.
    """
    for path in sorted(directory.glob("*.mcap")):
        try:
            found = repair(path, every_chunk=False, nice=_NICE) if _is_torn(path) else None
        except RecordingError as error:
            if isinstance(error.__cause__, Refusal) and error.__cause__.kind in ("limit", "crash"):
                yield path, error.__cause__
            continue
        except OSError:
            continue
        if found is not None:
            yield path, found


def _is_torn(path: Path) -> bool:
    """Return whether a file of this user lacks the end of a closed one."""
    if path.lstat().st_uid != os.geteuid():
        return False
    file = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC | os.O_NONBLOCK)
    try:
        return not is_closed(file)
    finally:
        os.close(file)
