"""Private directories of this user, created or checked. Files in them are opened without following links.

Anyone who can write into the directory of a rig can replace its files, take over its sockets and read its token; and
anyone can create it first in a public folder such as ``/tmp``. So owner, mode and type are checked through one
descriptor, and files are opened relative to it: the checked directory is the used one.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from trocar.services.files.trusted_path import fault_of_place
from trocar.services.runtime.errors import BusError

_OTHERS = stat.S_IRWXG | stat.S_IRWXO
#: Flags that open neither the target of a link nor wait for the writer of a pipe.
_AS_IT_IS = os.O_NOFOLLOW | os.O_CLOEXEC | os.O_NONBLOCK


def make_private(path: Path) -> Path:
    """Return `path` as a directory that no other user can enter, created with mode 0700 if missing.

    Raises BusError if it is a link, of another owner, accessible to others, or in a folder where others may replace it.
    """
    with _opened(path):
        return path


def open_private(path: Path, flags: int) -> int:
    """Return a descriptor of the file `path` in a private directory, without following links.

    A new file is readable by this user only.
    Raises BusError if the directory is not private, or the file is a link or no regular file. Raises FileNotFoundError
    if it is missing and `flags` do not create it.
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
    """Yield a descriptor of the private directory `path`."""
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


_INSTEAD = "name another as transport.directory"


def _fault(found: os.stat_result) -> str:
    """Return the reason why a directory is not private, empty if it is."""
    if found.st_uid != os.geteuid():
        return f"it belongs to user {found.st_uid}"
    if found.st_mode & _OTHERS:
        return f"others may use it (mode {stat.S_IMODE(found.st_mode):04o}, must be 0700)"
    return ""
