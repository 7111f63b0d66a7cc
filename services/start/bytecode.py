"""Where Python may keep no bytecode beside our source, it is kept in Trocar's cache.

A container that sets ``PYTHONDONTWRITEBYTECODE``, or a source tree that belongs to another user, makes each of the
rig's processes compile all of `trocar.services` and `trocar.protocol` at every start: a quarter of its start-up.
Bytecode that an image has beside the source is taken from there. What Python compiles of other packages stays as it
was.
"""

from __future__ import annotations

import contextlib
import functools
import os
import sys
from importlib.machinery import SOURCE_SUFFIXES, FileFinder, SourceFileLoader
from importlib.util import cache_from_source
from pathlib import Path
from types import CodeType

from trocar.services.files.cache_directory import cache_directory, own_folder

#: The folder of `trocar`, through which all that is ours is imported.
_ROOT = Path(__file__).parents[2]
_OURS = tuple(str(_ROOT / name) for name in ("services", "protocol"))


class _Loader(SourceFileLoader):
    """Reads and writes bytecode in the cache, whatever is asked of Python elsewhere."""

    def get_code(self, fullname: str) -> CodeType | None:
        """Return the code of a module."""
        prefix = "" if _is_beside(self.path) else _prefix(os.path.dirname(self.path), cache_directory())
        if not prefix:
            return super().get_code(fullname)
        before = sys.pycache_prefix, sys.dont_write_bytecode
        sys.pycache_prefix, sys.dont_write_bytecode = prefix, False
        try:
            return super().get_code(fullname)
        finally:
            sys.pycache_prefix, sys.dont_write_bytecode = before


def keep() -> None:
    """Let the modules that are imported from now on have their bytecode in the cache, where that is needed."""
    if sys.dont_write_bytecode or not os.access(_OURS[0], os.W_OK):
        sys.path_hooks.insert(0, _finder)
        sys.path_importer_cache.pop(_OURS[0], None)  # this module was found by Python's own


def _is_beside(source: str) -> bool:
    with contextlib.suppress(OSError):
        return os.stat(cache_from_source(source)).st_mtime >= os.stat(source).st_mtime
    return False


@functools.cache
def _prefix(source: str, cache: Path) -> str:
    """Return the folder that has the bytecode of a folder of source at its path; empty where it cannot be ours."""
    prefix = cache / "bytecode"
    try:
        own_folder(prefix.joinpath(*Path(source).parts[1:]), cache)
    except OSError:
        return ""
    return str(prefix)


def _finder(path: str) -> FileFinder:
    if path in _OURS or path.startswith(tuple(f"{each}{os.sep}" for each in _OURS)):
        return FileFinder(path, (_Loader, SOURCE_SUFFIXES))
    raise ImportError(path)
