"""Cached results of modules that analyse a scene in a process of their own, so that callers need no mechanics.

The imports would cost most of a second and a hundred megabytes, and the scene is unchanged at almost every start.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

from trocar.services.files.atomic_file import atomic_file
from trocar.services.files.cache_directory import cache_directory, make_folders
from trocar.services.kernels.source_closure import own_sources
from trocar.services.runtime.config import config
from trocar.services.runtime.errors import ConfigError, UserError

T = TypeVar("T")


def find_in_scene(module: str, scene: str, overrides: Sequence[str], read: Callable[[bytes], T]) -> T:
    """Return the output of ``python -m MODULE SCENE [KEY=VALUE ...]``, parsed by `read`.

    It is cached by the contents of scene, surface file and code. A cached output is computed again if `read` rejects it
    with a ValueError or ConfigError; for a new output these errors are passed on.
    Raises ConfigError: the module's error message, if the scene is invalid.
    """
    file = cache_directory() / "scenes" / _name(module, config.read_scene(scene, overrides))
    with contextlib.suppress(OSError, ValueError, ConfigError):  # missing, or truncated by a crash
        return read(file.read_bytes())
    found = _found(module, scene, overrides)
    with contextlib.suppress(OSError):  # without a cache the next start takes a second longer
        make_folders(file.parent)
        with atomic_file(file) as half:
            half.write_bytes(found)
    return read(found)


def print_finding(find: Callable[[str, Sequence[str]], bytes]) -> None:
    """Print the result of `find` for the command line's scene and overrides; the main function of such a module."""
    if len(sys.argv) < 2:
        sys.exit(f"usage: {sys.argv[0]} SCENE [KEY=VALUE ...]")
    try:
        sys.stdout.buffer.write(find(sys.argv[1], sys.argv[2:]))
    except UserError as error:
        sys.exit(str(error))


def _name(module: str, data: dict[str, Any]) -> str:
    text = f"{own_sources().digest(module)} {_surface_digest(data)} {json.dumps(data, sort_keys=True, default=str)}"
    return f"{module.rpartition('.')[2]}-{hashlib.sha256(text.encode()).hexdigest()[:32]}"


def _surface_digest(data: dict[str, Any]) -> str:
    """Return a hash of a scene's surface file, empty without one."""
    duct = data.get("duct")
    path = Path(str(duct.get("mesh_file") or "")) if isinstance(duct, dict) else Path()
    if not path.is_file():
        return ""
    with path.open("rb") as surface:
        return hashlib.file_digest(surface, "sha256").hexdigest()


def _found(module: str, scene: str, overrides: Sequence[str]) -> bytes:
    done = subprocess.run([sys.executable, "-m", module, scene, *overrides], capture_output=True, check=False)
    if done.returncode:
        said = done.stderr.decode(errors="replace").strip().splitlines()
        raise ConfigError((said or [f"{scene}: {module} ended with {done.returncode}"])[-1])
    return done.stdout
