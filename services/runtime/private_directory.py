"""A directory that is this user's alone: made so, or refused. Files in it are opened without following links.

Whoever may write into the directory of a rig can have its files replaced, its sockets taken and its token read; whoever
makes it first, in a folder for everybody such as ``/tmp``, owns it. So owner, mode and kind are looked at through one
descriptor, and files are opened relative to it: what was checked is what is used.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from services.runtime.errors import BusError
from services.trusted_path import fault_of_place

_OTHERS = 0o077
#: What a link points to is not opened, and a pipe that nobody writes into is not waited for.
_AS_IT_IS = os.O_NOFOLLOW | os.O_CLOEXEC | os.O_NONBLOCK


def make_private(path: Path) -> Path:
    """Return `path` as a directory that nobody else can enter; made with mode 0700 where it is missing.

    Raises BusError if it is a link, somebody else's, open to others, or in a folder where others may replace it.
    """
    with _opened(path):
        return path


def open_private(path: Path, flags: int) -> int:
    """Return a descriptor of the file `path` in a private directory, never of what a link there points to.

    A file that this makes can be read by this user only.
    Raises BusError if the directory is not private, or the file is a link, or no file at all. Raises FileNotFoundError
    if it is not there and `flags` do not make it.
    """
    with _opened(path.parent) as directory:
        try:
            descriptor = os.open(path.name, flags | _AS_IT_IS, 0o600, dir_fd=directory)
        except FileNotFoundError:
            raise
        except OSError as error:
            raise BusError(f"{path}: is not a file of ours: {error.strerror}") from None
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise BusError(f"{path}: is not a file of ours: neither a link nor a pipe nor a device is taken")
    return descriptor


def open_text(path: Path, flags: int = os.O_RDONLY) -> IO[str]:
    """Return `open_private` as a text file: for reading, or with ``O_RDWR`` or ``O_WRONLY`` for that."""
    kind = {os.O_RDONLY: "r", os.O_WRONLY: "w", os.O_RDWR: "r+"}[flags & os.O_ACCMODE]
    return os.fdopen(open_private(path, flags), kind, encoding="utf-8")


@contextmanager
def _opened(path: Path) -> Iterator[int]:
    """Yield a descriptor of the directory `path`, which is private."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        path.mkdir(exist_ok=True, mode=0o700)
        descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
    except OSError as error:
        kind = "is a link or no directory" if path.is_symlink() or path.exists() else error.strerror
        raise BusError(f"{path}: cannot be the rig's private directory: {kind}; {_INSTEAD}") from None
    try:
        fault = _fault(os.fstat(descriptor)) or fault_of_place(path, its_own=False)
        if fault:
            raise BusError(f"{path}: cannot be the rig's private directory: {fault}; {_INSTEAD}")
        yield descriptor
    finally:
        os.close(descriptor)


_INSTEAD = "remove it, or name another as transport.directory"


def _fault(found: os.stat_result) -> str:
    """Return what keeps a directory from being private, empty for nothing."""
    if found.st_uid != os.geteuid():
        return f"it belongs to user {found.st_uid}"
    if found.st_mode & _OTHERS:
        return f"others may use it (mode {stat.S_IMODE(found.st_mode):04o}, must be 0700)"
    return ""
