"""Where compiled kernels are kept: in a folder that belongs to exactly the source that they were made of.

numba files a kernel under the place of its file, and looks whether that file has changed, but not those of the kernels
that it calls: after an update a cached kernel may go on calling what its neighbour was before, and no checkout finds
what another has compiled. So numba is given a locator of ours (``NUMBA_CACHE_LOCATOR_CLASSES``): the folder of a kernel
is named by its module and a hash of all source that the module rests on. numba reads the variable when it is imported,
so `services` itself calls `choose`.
"""

from __future__ import annotations

import contextlib
import fcntl
import functools
import hashlib
import os
import shutil
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import IO

from services.cache_directory import cache_directory
from services.source_closure import Sources

_NUMBAS_OWN = ("UserProvidedCacheLocator", "InTreeCacheLocator", "UserWideCacheLocator", "IPythonCacheLocator")
_OPTIONS = ("NUMBA_BOUNDSCHECK", "NUMBA_OPT", "NUMBA_DEBUGINFO", "NUMBA_LOOP_VECTORIZE", "NUMBA_SLP_VECTORIZE")
_KEPT = 8
_IN_USE_S = 3600.0


def choose() -> None:
    """Let numba keep our kernels in `root`, here and in the children of this process."""
    ours = f"{Locator.__module__}.{Locator.__qualname__}"
    named = os.environ.get("NUMBA_CACHE_LOCATOR_CLASSES") or ",".join(_NUMBAS_OWN)
    if ours not in named.split(","):
        os.environ["NUMBA_CACHE_LOCATOR_CLASSES"] = f"{ours},{named}"
    if "numba" in sys.modules:
        sys.modules["numba"].config.reload_config()


def root() -> Path:
    """Return ``$NUMBA_CACHE_DIR``, else ``kernels`` in Trocar's cache. It may be shared by any number of checkouts."""
    return Path(os.environ.get("NUMBA_CACHE_DIR") or cache_directory() / "kernels")


class Locator:
    """Tells numba where the compiled kernels of one function lie; made by numba, for functions of ours only."""

    def __init__(self, folder: Path, line: int) -> None:
        self._folder = folder
        self._line = line

    @classmethod
    def from_function(cls, function: Callable[..., object], path: str) -> Locator | None:
        """Return the locator of a function, None if its file is not ours or nothing can be written."""
        folder = _folder(path, root())
        return None if folder is None else cls(folder, function.__code__.co_firstlineno)

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
            self._folder.mkdir(parents=True, exist_ok=True)
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
        self._local.file = path.open("wb")
        end_s = time.monotonic() + self._PATIENCE_S
        while time.monotonic() < end_s:
            with contextlib.suppress(BlockingIOError):
                fcntl.flock(self._local.file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                return
            time.sleep(self._APART_S)

    def release(self) -> None:
        """Let go of the lock, if one is held."""
        file: IO[bytes] | None = getattr(self._local, "file", None)
        if file is not None:
            file.close()
            self._local.file = None


_LOCK = _Lock()


@functools.cache
def _folder(path: str, root: Path) -> Path | None:
    """Return the folder of a file's kernels below `root`, marked as used, or None."""
    module = _sources().module_of(Path(path))
    if module is None or not _is_writable(root):
        return None
    folder = root / f"{module}-{_digest(module)}"
    with contextlib.suppress(FileNotFoundError):
        os.utime(folder)
    return folder


@functools.cache
def _sources() -> Sources:
    return Sources(Path(__file__).parents[1])


@functools.cache
def _digest(module: str) -> str:
    """Return a hash of what decides what the kernels of a module are, beyond signature and processor."""
    versions = [sys.modules[name].__version__ for name in ("numba", "llvmlite", "numpy")]
    options = [f"{name}={os.environ.get(name)}" for name in _OPTIONS]
    text = "\n".join([_sources().digest(module), *versions, *options])
    return hashlib.sha256(text.encode()).hexdigest()[:16]


@functools.cache
def _is_writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
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
