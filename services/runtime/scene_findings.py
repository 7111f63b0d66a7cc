"""What a module finds in a scene, in a process of its own, and kept: who asks for it runs none of the mechanics.

To import what it takes costs most of a second of a processor and a hundred megabytes, and a scene is found as it was at
almost every start.
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

from services.atomic_file import atomic_file
from services.cache_directory import cache_directory
from services.runtime import config
from services.runtime.errors import ConfigError, UserError
from services.source_closure import Sources

T = TypeVar("T")


def find_in_scene(module: str, scene: str, overrides: Sequence[str], read: Callable[[bytes], T]) -> T:
    """Return what ``python -m MODULE SCENE [KEY=VALUE ...]`` prints, as `read` understands it.

    It is kept by what scene and surface file say and by the code that finds it. What is kept is found anew where `read`
    refuses it with a ValueError or ConfigError; of what was found just now these go to the caller.
    Raises ConfigError: the module's one sentence, if the scene cannot be used.
    """
    file = cache_directory() / "scenes" / _name(module, config.read_scene(scene, overrides))
    with contextlib.suppress(OSError, ValueError, ConfigError):  # not there, or cut short by a crash
        return read(file.read_bytes())
    found = _found(module, scene, overrides)
    with contextlib.suppress(OSError):  # a cache that cannot be written costs the next start a second
        file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        with atomic_file(file) as half:
            half.write_bytes(found)
    return read(found)


def print_finding(find: Callable[[str, Sequence[str]], bytes]) -> None:
    """Print what `find` returns for the scene and overrides on the command line: the main of what is asked above."""
    if len(sys.argv) < 2:
        sys.exit(f"usage: {sys.argv[0]} SCENE [KEY=VALUE ...]")
    try:
        sys.stdout.buffer.write(find(sys.argv[1], sys.argv[2:]))
    except UserError as error:
        sys.exit(str(error))


def _name(module: str, data: dict[str, Any]) -> str:
    code = Sources(Path(__file__).parents[2]).digest(module)
    text = f"{code} {_surface_digest(data)} {json.dumps(data, sort_keys=True, default=str)}"
    return f"{module.rpartition('.')[2]}-{hashlib.sha256(text.encode()).hexdigest()[:32]}"


def _surface_digest(data: dict[str, Any]) -> str:
    """Return a hash of the surface file that a scene names, empty where it names none or there is no such file."""
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
