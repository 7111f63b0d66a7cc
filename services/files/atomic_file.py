"""Atomic writes: a reader sees a whole file or folder or none of it, and only complete lines of a log."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def atomic_file(path: Path) -> Iterator[Path]:
    """Yield where to write what becomes `path` when all is written; if that fails, `path` stays as it was.

    A device, a pipe and a link are written to as they are: `/dev/stdout` is a link, also where it leads to a file. So
    is a file in a folder that is closed to this user. The other name ends as `path` does: some writers go by that.
    """
    is_other = path.is_symlink() or (path.exists() and not path.is_file())
    if is_other or (path.exists() and not os.access(path.absolute().parent, os.W_OK)):
        yield path
        return
    half = path.with_name(f".{os.getpid()}.{path.name}")
    try:
        yield half
        half.replace(path)
    finally:
        half.unlink(missing_ok=True)


@contextmanager
def atomic_folder(path: Path) -> Iterator[Path]:
    """Yield a folder, not made yet, that becomes `path`, where nothing or an empty folder is, when all is written.

    If that fails, nothing of it stays.
    """
    half = path.absolute().with_name(f".{os.getpid()}.{path.absolute().name}")
    try:
        yield half
        half.replace(path)
    finally:
        shutil.rmtree(half, ignore_errors=True)


def complete_lines(path: Path) -> list[str]:
    """Return the lines of a log, none without one; an unfinished last line is cut off, so that the next begins anew."""
    text = path.read_bytes() if path.exists() else b""
    end = text.rfind(b"\n") + 1
    if end < len(text):
        os.truncate(path, end)
    return text[:end].decode().splitlines()
