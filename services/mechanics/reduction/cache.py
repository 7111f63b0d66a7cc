"""Results kept on disk by name: numpy files, the large ones memory mapped, made once and never half visible.

An entry is a folder of ``.npy`` arrays, a ``manifest.json`` and ``hashes`` of both. It is written beside its place and
renamed into it, so a reader sees all of it or nothing; a lock file keeps processes that start together from making
the same entry twice. Nothing is pickled. What is not as it was written when it is fetched is made anew, and so is what
others can change: the hashes lie beside the data, so whoever changes one can change the other.

Other code makes entries of other names (`content_hash.entry_name`), and every duct makes its own. When an entry is
made, those used longest ago go until the folder takes no more of the disk than `KEPT_BYTES`.
"""

from __future__ import annotations

import contextlib
import dataclasses
import fcntl
import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Literal, TypeVar, get_type_hints

import numpy as np

from trocar.services.files.cache_directory import (
    KEPT_BYTES,
    cache_directory,
    discard,
    fault_in,
    forget_beyond,
    make_folders,
)

T = TypeVar("T")

MANIFEST = "manifest.json"
_HASHES = "hashes"


class CacheError(RuntimeError):
    """An entry on disk is damaged; the message names it."""


class Entry:
    """One folder of arrays; writable while it is being made, read-only afterwards."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def save(self, name: str, array: np.ndarray[Any, Any]) -> None:
        """Write one array."""
        np.save(self._file(name), array, allow_pickle=False)

    def create(self, name: str, shape: tuple[int, ...], dtype: type[np.generic]) -> np.ndarray[Any, Any]:
        """Return a new array on disk, to be filled piece by piece without ever being in memory as a whole."""
        return np.lib.format.open_memmap(self._file(name), mode="w+", dtype=dtype, shape=shape)

    def describe(self, **facts: Any) -> None:
        """Write the manifest."""
        (self.folder / MANIFEST).write_text(json.dumps(facts, indent=1), encoding="utf-8")

    def load(self, name: str) -> np.ndarray[Any, Any]:
        """Read one array into memory of this process. Raises CacheError if the file is missing or damaged."""
        return self._read(name, None)

    def share(self, name: str) -> np.ndarray[Any, Any]:
        """Map one large array read-only and touch its pages, so that no later read waits for the disk.

        All processes that map it have it in memory once. A mapping that may be written to, copy on write, would become
        each one's own as soon as its memory is locked: the kernel then writes to every such page.
        Raises CacheError if the file is missing or damaged.
        """
        array = np.asarray(self._read(name, "r"))
        words_a_page = max(4096 // array.itemsize, 1)
        array.reshape(-1)[::words_a_page].sum()
        return array

    def _read(self, name: str, mmap_mode: Literal["r"] | None) -> np.ndarray[Any, Any]:
        try:
            array: np.ndarray[Any, Any] = np.load(self._file(name), mmap_mode=mmap_mode, allow_pickle=False)
        except (OSError, ValueError) as error:
            raise CacheError(f"cache entry {self.folder} is damaged, remove it: {error}") from error
        return array

    @property
    def facts(self) -> dict[str, Any]:
        """The manifest. Raises CacheError if it is missing or damaged."""
        try:
            facts: dict[str, Any] = json.loads((self.folder / MANIFEST).read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise CacheError(f"cache entry {self.folder} is damaged, remove it: {error}") from error
        return facts

    def _file(self, name: str) -> Path:
        return self.folder / f"{name}.npy"


def fetch(cache_dir: Path, name: str, make: Callable[[Entry], None]) -> Entry:
    """Return the entry ``name``, calling ``make`` to fill it if it does not exist yet or is not as it was written.

    Processes that ask for the same missing entry at the same time wait for the first of them.
    """
    folder = cache_dir / name
    if _fault(folder):
        make_folders(cache_dir)
        with _locked(cache_dir / f".{name}.lock"):
            if fault := _fault(folder):
                discard(folder, fault)  # a process that has mapped it keeps what it has
                _make_atomically(folder, make)
                forget_beyond(KEPT_BYTES, _entries_of(cache_dir))
    with contextlib.suppress(OSError):  # a cache that is only read
        os.utime(folder)
    return Entry(folder)


def fetch_record(cache_dir: Path | None, name: str, kind: type[T], make: Callable[[], T], **facts: Any) -> T:
    """Return a record that ``make`` makes where the cache has none: a dataclass of arrays, integers, and such records.

    ``facts`` are for the manifest.
    """

    def fill(entry: Entry) -> None:
        _save_record(entry, "", make())
        entry.describe(**facts)

    record: T = _load_record(fetch(cache_dir or cache_directory(), name, fill), "", kind)
    return record


def _save_record(entry: Entry, prefix: str, record: Any) -> None:
    for field in dataclasses.fields(record):
        value = getattr(record, field.name)
        if dataclasses.is_dataclass(value):
            _save_record(entry, f"{prefix}{field.name}.", value)
        else:
            entry.save(prefix + field.name, np.asarray(value))


def _load_record(entry: Entry, prefix: str, kind: Any) -> Any:
    values: dict[str, Any] = {}
    for name, each in get_type_hints(kind).items():
        if dataclasses.is_dataclass(each):
            values[name] = _load_record(entry, f"{prefix}{name}.", each)
        else:
            array = entry.load(prefix + name)
            values[name] = int(array) if each is int else array
    return kind(**values)


def _entries_of(cache_dir: Path) -> Iterator[Path]:
    return (path for path in cache_dir.glob("[!.]*-*") if path.is_dir())


def _make_atomically(folder: Path, make: Callable[[Entry], None]) -> None:
    for left in folder.parent.glob(f".{folder.name}.*/"):  # by a process that was killed: this one has the lock
        shutil.rmtree(left, ignore_errors=True)
    unfinished = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
    try:
        make(Entry(unfinished))
        (unfinished / _HASHES).write_text(_hashes(unfinished), encoding="utf-8")
        os.replace(unfinished, folder)
    except BaseException:
        shutil.rmtree(unfinished, ignore_errors=True)
        raise


def _fault(folder: Path) -> str:
    """Return what is wrong with an entry, as the rest of a sentence; empty if it may be used."""
    if fault := fault_in(folder.parent, folder):
        return f"is not used: {fault}"
    try:
        is_whole = (folder / _HASHES).read_bytes() == _hashes(folder).encode()
    except OSError:
        is_whole = False
    return "" if is_whole else "is not as it was written"


def _hashes(folder: Path) -> str:
    lines = []
    for path in sorted(set(folder.iterdir()) - {folder / _HASHES}):
        with path.open("rb") as file:
            lines.append(f"{hashlib.file_digest(file, 'sha256').hexdigest()} {path.name}\n")
    return "".join(lines)


@contextlib.contextmanager
def _locked(path: Path) -> Iterator[None]:
    with path.open("w", encoding="utf-8") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield
