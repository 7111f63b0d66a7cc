"""Whether a start will compile: told at once, before any process has imported what compiles.

Physics leaves a mark in the kernel cache when all its kernels are there; its name is a hash of what decides whether
they can be used again. Kernels that came with the package take its place: if they do not fit, who unpacks them says so.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import sys
from importlib import metadata
from pathlib import Path

from trocar.services.files.cache_directory import forget_unused
from trocar.services.kernels import kernel_archive, kernel_cache
from trocar.services.kernels.processor import target_name

NOTICE = "first start: compiles for about a minute; later ones take seconds"
_FOLDERS = "mechanics", "physics", "haptics", "gateway"


def notice() -> str:
    """Return what is said of a start that will compile; empty if its kernels are there, or came with the package."""
    return "" if _mark().exists() or _came_with_package() else NOTICE


def notice_of_misfit() -> str:
    """Return what is said of a start that compiles although kernels came with the package, with the reason.

    Asked by a process that compiles, since only there numba is imported.
    """
    misfit = kernel_archive.unpack(kernel_cache.root())
    return f"{NOTICE}; {misfit}" if misfit and not _mark().exists() else ""


def leave_mark() -> None:
    """Remember that all kernels of these sources are in the cache."""
    mark = _mark()
    with contextlib.suppress(OSError):  # then the next start only says more than it needs to
        mark.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        mark.touch()
        forget_unused(mark.parent.glob("complete-*"))


def _came_with_package() -> bool:
    return kernel_archive.FOLDER.is_dir() and any(kernel_archive.FOLDER.glob(f"*{kernel_archive.SUFFIX}"))


def _mark() -> Path:
    return kernel_cache.root() / f"complete-{_fingerprint()}"


@functools.cache
def _fingerprint() -> str:
    versions = [metadata.version(name) for name in ("numba", "llvmlite", "numpy")]
    digest = hashlib.sha256(" ".join([sys.version, target_name(), *versions]).encode())
    here = Path(__file__).parents[1]
    for path in sorted(path for name in _FOLDERS for path in (here / name).rglob("*.py")):
        digest.update(os.fsencode(path.relative_to(here)) + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]
