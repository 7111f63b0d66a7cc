"""Recordings of attempts that are erased: which of them may go, and removing them."""

from __future__ import annotations

import os
import stat
from collections.abc import Mapping, Sequence
from pathlib import Path
from urllib.parse import unquote_to_bytes, urlsplit

import msgspec

_MAGIC = b"\x89MCAP0\r\n"
_ENCODED = "file://"


class Plan(msgspec.Struct, frozen=True, kw_only=True):
    """What is kept of a trainee: a number of attempts, and their recordings.

    Attributes:
        own: Recordings that hold attempts of this trainee only.
        shared: Those that hold attempts of others, too, and of whom.
        missing: Those that are not where they were judged: moved, or removed before.
    """

    trainee: str
    attempts: int
    own: Sequence[Path] = ()
    shared: Mapping[Path, Sequence[str]] = {}
    missing: Sequence[Path] = ()


class Erased(msgspec.Struct, frozen=True, kw_only=True):
    """What has become of a trainee's attempts and recordings.

    Attributes:
        attempts: How many are erased.
        left: How many stay, as their recordings could not be removed: a second try takes them.
        removed: Recordings that are gone, with the number of other names (hard links) that their content still has.
        shared, missing: As in `Plan`; they stay as they are.
        failed: Recordings that could not be removed, and why.
    """

    trainee: str
    attempts: int
    left: int
    removed: Mapping[Path, int] = {}
    shared: Mapping[Path, Sequence[str]] = {}
    missing: Sequence[Path] = ()
    failed: Mapping[Path, str] = {}


def to_stored(path: Path) -> str:
    """Return a recording's place as a database keeps it; a name that is no UTF-8 as the address of the file."""
    place = path.resolve()
    try:
        str(place).encode()
    except UnicodeEncodeError:
        return place.as_uri()
    return str(place)


def from_stored(stored: str) -> Path:
    """Return the place of a recording as `to_stored` wrote it."""
    if not stored.startswith(_ENCODED):
        return Path(stored)
    return Path(os.fsdecode(unquote_to_bytes(urlsplit(stored).path)))


def is_there(path: Path) -> bool:
    """Return whether anything has this name, also a link that leads nowhere."""
    return os.path.lexists(path)


def remove(path: Path) -> int:
    """Remove a recording; return how many other names its content still has.

    Raises OSError if it cannot be removed, or no recording is in its place.
    """
    found = path.lstat()
    if stat.S_ISLNK(found.st_mode):
        raise OSError(f"a link to {os.readlink(path)} is in its place")
    if stat.S_ISDIR(found.st_mode):
        raise OSError("a folder is in its place")
    if not stat.S_ISREG(found.st_mode) or not _is_recording(path):
        raise OSError("something that is no recording is in its place")
    path.unlink()
    return found.st_nlink - 1


def reason_of(error: OSError) -> str:
    """Return why a file could not be removed."""
    return (error.strerror or str(error)).lower()


def _is_recording(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(len(_MAGIC)) == _MAGIC
