"""Where compiled kernels are kept: in a folder that belongs to exactly the source that they were made of.

numba files a kernel under the place of its file, and looks whether that file has changed, but not those of the kernels
that it calls: after an update a cached kernel may go on calling what its neighbour was before, and no checkout finds
what another has compiled. So numba is given a locator of ours while our kernels are decorated
(`trocar.services.mechanics.compiled`): the folder of a kernel is named by its module and a hash of all source that the
module rests on.

What numba reads is unpickled and run. So the folder must be one that only this user and root can change, and what lies
in it must be what was stored: a kernel's lock file holds the hashes of its files.
"""

from __future__ import annotations

import atexit
import contextlib
import fcntl
import functools
import hashlib
import os
import re
import shutil
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import IO

from trocar.services.files.cache_directory import cache_directory, make_folders, trusted_directory
from trocar.services.files.trusted_path import fault_of_place
from trocar.services.kernels import kernel_archive
from trocar.services.kernels.source_closure import own_sources

_OPTIONS = ("NUMBA_BOUNDSCHECK", "NUMBA_OPT", "NUMBA_DEBUGINFO", "NUMBA_LOOP_VECTORIZE", "NUMBA_SLP_VECTORIZE")
_FILE = re.compile(r"-(\d+)\.py\w+\.(?:nbi|\d+\.nbc)")
_KEPT = 8  # versions of a module, for as many checkouts or branches by turns; more would fill the disk
#: A start that compiles everything takes a minute, so that a folder untouched for this long is not at work.
_IN_USE_S = 3600.0


def root() -> Path:
    """Return ``$NUMBA_CACHE_DIR``, else ``kernels`` in Trocar's cache. It may be shared by any number of checkouts."""
    if os.environ.get("NUMBA_CACHE_DIR"):
        return trusted_directory("NUMBA_CACHE_DIR", "")
    return cache_directory() / "kernels"


def write_hashes(folder: Path) -> None:
    """Write the hashes of all kernels in a folder as it is now: what made it has rewritten them."""
    for line, files in _files(folder).items():
        (folder / f"{line}.lock").write_text(_hashes(files))


def settle() -> None:
    """Write the hashes of the kernel that this thread has stored last, and let go of it."""
    _LOCK.release()


class Locator:
    """Tells numba where the compiled kernels of one function lie; made by numba, for functions of ours only."""

    def __init__(self, folder: Path, line: int) -> None:
        self._folder = folder
        self._line = line

    @classmethod
    def from_function(cls, function: Callable[..., object], path: str) -> Locator | None:
        """Return the locator of a function, None if its file is not ours or nothing can be written."""
        folder, line = _folder(path, root()), function.__code__.co_firstlineno
        return cls(folder, line) if folder and _is_as_stored(folder, line) else None

    def get_cache_path(self) -> str:
        """Return the folder of this function's module as it is now."""
        return str(self._folder)

    def get_source_stamp(self) -> str:
        """Return what a stored kernel must have been made of: the folder says it."""
        return self._folder.name

    def get_disambiguator(self) -> str:
        """Return what tells functions of one name in one module apart."""
        return str(self._line)

    def ensure_cache_path(self) -> None:
        """Make the folder. numba calls this right before it stores a kernel, so it also takes the kernel's lock.

        numba numbers the files of a kernel's signatures by reading the index, and two processes that store two
        signatures at once would give both the same number: one would later run code made for other types.
        """
        if not self._folder.is_dir():
            _forget_oldest(self._folder)
            make_folders(self._folder)
        _LOCK.hold(self._folder / f"{self._line}.lock")


class _Lock:
    """The lock file of the kernel that this thread stores, or has stored last; thread-local, as compilations are."""

    _PATIENCE_S = 5.0
    _APART_S = 0.01

    def __init__(self) -> None:
        self._local = threading.local()

    def hold(self, path: Path) -> None:
        """Let go of the lock that is held and take another; one that is not free after five seconds is not waited for.

        Nobody says when numba has stored a kernel, which takes milliseconds: its lock is held until the next one is.
        """
        self.release()
        self._local.file, self._local.path = path.open("a+"), path
        end_s = time.monotonic() + self._PATIENCE_S
        while not _locks(self._local.file) and time.monotonic() < end_s:
            time.sleep(self._APART_S)

    def release(self) -> None:
        """Write what was stored into the lock, if one is held, and let go of it."""
        file: IO[str] | None = getattr(self._local, "file", None)
        if file is not None:
            self._local.file = None
            with file:
                file.truncate(0)
                path = self._local.path
                file.write(_hashes(_files(path.parent).get(int(path.stem), [])))


def _locks(file: IO[str]) -> bool:
    """Whether the lock of a file was free; it is taken then."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _files(folder: Path) -> dict[int, list[Path]]:
    """Return the files of the kernels in a folder by the line of the kernel, in the order of their names."""
    found: dict[int, list[Path]] = {}
    for name in sorted(os.listdir(folder) if folder.is_dir() else ()):
        if match := _FILE.search(name):
            found.setdefault(int(match[1]), []).append(folder / name)
    return found


_files_at_first = functools.cache(_files)


def _hashes(files: list[Path]) -> str:
    return "".join(f"{hashlib.sha256(path.read_bytes()).hexdigest()} {path.name}\n" for path in files)


@functools.cache
def _is_as_stored(folder: Path, line: int) -> bool:
    """Whether numba may read a kernel's files; what is not as it was stored is removed, unless it is being stored now.

    False where it cannot be removed.
    """
    if not (files := _files_at_first(folder).get(line)):
        return True
    try:
        with (folder / f"{line}.lock").open("a+") as lock:
            if _agree(lock, files) or not _locks(lock):
                return True
            return _agree(lock, _files(folder).get(line, [])) or _emptied(folder, line)
    except OSError:
        return False


def _agree(lock: IO[str], files: list[Path]) -> bool:
    lock.seek(0)
    known = all(found.st_uid in (0, os.geteuid()) for found in (os.stat(lock.fileno()), *map(os.stat, files)))
    return known and lock.read() == _hashes(files)


def _emptied(folder: Path, line: int) -> bool:
    for path in _files(folder).get(line, []):
        path.unlink()
    _say_once(f"{folder}: a compiled kernel is not as it was stored; it is compiled anew")
    return True


@functools.cache
def _say_once(text: str) -> None:
    print(text, file=sys.stderr)  # noqa: T201


_LOCK = _Lock()
atexit.register(settle)


@functools.cache
def _folder(path: str, root: Path) -> Path | None:
    """Return the folder of a file's kernels below `root`, marked as used, or None."""
    module = own_sources().module_of(Path(path))
    if module is None or not _is_writable(root):
        return None
    if fault := kernel_archive.unpack(root):
        _say_once(f"{fault}: they are compiled anew, which takes about a minute")
    folder = root / f"{module}-{_digest(module)}"
    if fault_of_place(folder):
        return None
    with contextlib.suppress(FileNotFoundError):
        os.utime(folder)
    return folder


@functools.cache
def _digest(module: str) -> str:
    """Return a hash of what decides what the kernels of a module are, beyond signature and processor."""
    versions = [sys.modules[name].__version__ for name in ("numba", "llvmlite")]
    options = [f"{name}={os.environ.get(name)}" for name in _OPTIONS]
    text = "\n".join(["with hashes", own_sources().digest(module), *versions, *options])
    return digest_of(text)


def digest_of(text: str) -> str:
    """Return the short hash of a text by which folders and archives are named."""
    return hashlib.sha256(text.encode()).hexdigest()[:16]


@functools.cache
def _is_writable(folder: Path) -> bool:
    try:
        make_folders(folder)
    except OSError:
        return False
    return os.access(folder, os.W_OK)


def _forget_oldest(folder: Path) -> None:
    """Keep the last used few of the folders of a module, and those in which somebody may be at work."""
    ages = []
    for path in folder.parent.glob(f"{folder.name.rpartition('-')[0]}-*"):
        with contextlib.suppress(FileNotFoundError):  # another process forgets it, too
            ages.append((time.time() - path.stat().st_mtime, path))
    for age_s, path in sorted(ages)[_KEPT - 1 :]:
        if age_s > _IN_USE_S:
            shutil.rmtree(path, ignore_errors=True)
