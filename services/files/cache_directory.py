"""Where bases, meshes and compiled kernels are kept between runs: some of it is run, so nobody else may write there."""

from __future__ import annotations

import atexit
import contextlib
import functools
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from pathlib import Path

from trocar.services.files.trusted_path import fault_of_place

#: What no run has used for so long is removed. Assumption: after a quarter of a year nobody goes back to other code.
UNUSED_S = 90.0 * 86400.0
#: What the bases keep of the disk, in bytes. The largest entry of a drawn duct takes half a gigabyte and most take
#: 30 to 130 MB, so every scene and duct that a user goes back to stays, and a study of hundreds of ducts does not.
KEPT_BYTES = 8 << 30
#: What a run used so lately is never removed, in seconds: a start opens its arrays within a minute of asking for them.
IN_USE_S = 600.0
#: Folder of dumps in the cache, which no program reads.
_FOR_PEOPLE = "dumps"


def cache_directory() -> Path:
    """Return ``$TROCAR_CACHE_DIR``, else ``$XDG_CACHE_HOME/trocar``, else ``~/.cache/trocar``.

    It need not be there yet. Where it cannot be made or written to, a fresh folder takes its place for this process and
    its children.
    Folders in it that others can change are removed when a process first asks, and a line says why.
    """
    path = trusted_directory("TROCAR_CACHE_DIR", _of_user())
    return (
        path if _is_rid_of_foreign(path) else _replaced(path, "TROCAR_CACHE_DIR", "what others can change stays in it")
    )


def trusted_directory(variable: str, default: str) -> Path:
    """Return the folder that an environment variable names, or `default`.

    Where others can change it, or this user cannot make it or write to it, a fresh folder takes its place, for this
    process and its children; a line says why.
    """
    path = Path(named := os.environ.get(variable) or default)
    if not (fault := _fault(named)):
        return path
    return _replaced(path, variable, fault)


def _of_user() -> str:
    """Return the user's cache of Trocar; the XDG specification has a relative path in its variable ignored."""
    named = os.environ.get("XDG_CACHE_HOME", "")
    return os.path.join(named if os.path.isabs(named) else os.path.expanduser("~/.cache"), "trocar")


def fault_in(root: Path, path: Path) -> str:
    """Return why a folder in `root` is not used, empty if it may be or is not there; `root` itself is not judged."""
    return fault_of_place(path, below=root) or (
        "it is no folder" if os.path.lexists(path) and not path.is_dir() else ""
    )


def discard(path: Path, why: str) -> None:
    """Remove what lies at a place, and say it. What of another's folder cannot be removed is out of the way.

    Raises OSError where this user may not write to the folder that it lies in.
    """
    aside = path.with_name(f".{path.name}.{os.urandom(4).hex()}")
    with contextlib.suppress(FileNotFoundError):  # another process was faster
        path.rename(aside)
        print(f"{path} {why}; it is made anew", file=sys.stderr)  # noqa: T201
        if aside.is_dir() and not aside.is_symlink():
            shutil.rmtree(aside, ignore_errors=True)
        else:
            aside.unlink()


def make_folders(folder: Path) -> None:
    """Make a folder, and those that are missing above it, for this user alone whatever the umask is."""
    if not folder.is_dir():
        make_folders(folder.parent)
        folder.mkdir(mode=0o700, exist_ok=True)


def forget_unused(paths: Iterable[Path]) -> None:
    """Remove those files and folders that no run has used for `UNUSED_S`; their own times say when that was."""
    for path in paths:
        with contextlib.suppress(OSError):  # another process was faster, or it is not this user's
            if time.time() - path.stat().st_mtime > UNUSED_S:
                shutil.rmtree(path) if path.is_dir() else path.unlink()


def forget_beyond(limit_bytes: int, folders: Iterable[Path]) -> None:
    """Remove the folders that were used longest ago until the rest takes at most so many bytes.

    Their own times say when they were used last. What was used within `IN_USE_S` stays, even where that is too much.
    """
    kept_bytes, now_s = 0, time.time()
    for used_s, folder in sorted(_uses(folders), reverse=True):
        kept_bytes += _bytes_of(folder)
        if kept_bytes > limit_bytes and now_s - used_s > IN_USE_S:
            shutil.rmtree(folder, ignore_errors=True)


def _uses(folders: Iterable[Path]) -> Iterator[tuple[float, Path]]:
    for folder in folders:
        with contextlib.suppress(OSError):  # another process was faster
            yield folder.stat().st_mtime, folder


def _bytes_of(folder: Path) -> int:
    try:
        return sum(path.stat().st_size for path in folder.iterdir())
    except OSError:  # another process was faster
        return 0


@functools.cache
def _is_rid_of_foreign(cache: Path) -> bool:
    """Remove the folders of the cache that others can change; return whether none stays."""
    try:
        folders = [path for path in cache.iterdir() if path.is_dir()] if cache.is_dir() else []
        for path in folders:
            aside = path.name.startswith(".") or path.name == _FOR_PEOPLE
            if not aside and (fault := fault_in(cache, path)):
                discard(path, f"is not used: {fault}")
    except OSError:
        return False
    return True


def _replaced(path: Path, variable: str, fault: str) -> Path:
    fresh = _fresh() / path.name
    os.environ[variable] = str(fresh)
    print(f"{path} is not used: {fault}; for this run {fresh} is", file=sys.stderr)  # noqa: T201
    return fresh


@functools.cache
def _fault(path: str) -> str:
    if path.startswith("~"):
        return "this user has no home"
    if os.path.exists(path) and not os.path.isdir(path):
        return "it is no folder"
    return fault_of_place(Path(path)) or _fault_of_making(Path(path))


def _fault_of_making(path: Path) -> str:
    """Return why nothing can be kept in a folder, which may still have to be made; empty if it can."""
    nearest = next(each for each in (path.absolute(), *path.absolute().parents) if each.exists())
    if not nearest.is_dir():
        return f"{nearest} is no folder"
    return "" if os.access(nearest, os.W_OK | os.X_OK) else f"this user may not write to {nearest}"


@functools.cache
def _fresh() -> Path:
    folder, maker = tempfile.mkdtemp(prefix="trocar-cache-"), os.getpid()
    atexit.register(lambda: shutil.rmtree(folder, ignore_errors=True) if os.getpid() == maker else None)
    return Path(folder)
