"""Where bases, meshes and compiled kernels are kept between runs: some of it is run, so nobody else may write there."""

from __future__ import annotations

import atexit
import functools
import os
import shutil
import sys
import tempfile
from pathlib import Path

from services.trusted_path import fault_of_place


def cache_directory() -> Path:
    """Return ``$TROCAR_CACHE_DIR``, else ``~/.cache/trocar``; whether there is such a folder is another question."""
    return trusted_directory("TROCAR_CACHE_DIR", os.path.expanduser("~/.cache/trocar"))


def trusted_directory(variable: str, default: str) -> Path:
    """Return the folder that an environment variable names, or `default`.

    Where others can change it, a fresh folder takes its place, for this process and its children; a line says why.
    """
    path = Path(named := os.environ.get(variable) or default)
    if not (fault := _fault(named)):
        return path
    fresh = _fresh() / path.name
    os.environ[variable] = str(fresh)
    print(f"{path} is not used: {fault}; for this run {fresh} is", file=sys.stderr)  # noqa: T201
    return fresh


@functools.cache
def _fault(path: str) -> str:
    return fault_of_place(Path(path)) or ("it is no folder" if os.path.exists(path) and not os.path.isdir(path) else "")


@functools.cache
def _fresh() -> Path:
    folder, maker = tempfile.mkdtemp(prefix="trocar-cache-"), os.getpid()
    atexit.register(lambda: shutil.rmtree(folder, ignore_errors=True) if os.getpid() == maker else None)
    return Path(folder)
