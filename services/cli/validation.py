"""The check of a rig's options in a process of its own, before anything is started.

What a scene is checked against takes a second and 100 MB to import, and the supervisor itself has no use for it.
Options and files that were found sound before are not checked again, so that a warm start does not wait.
"""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from trocar.services.files.atomic_file import atomic_file, complete_lines
from trocar.services.files.cache_directory import cache_directory, make_folders
from trocar.services.runtime.config import config
from trocar.services.runtime.errors import ConfigError, UserError

_REMEMBERED = 100  # of 64 characters each: more than a person uses by turns; what is forgotten is checked again


class RefusedError(UserError):
    """Options that a rig cannot run with; with the exit code of the check."""

    def __init__(self, sentence: str, exit_code: int) -> None:
        super().__init__(sentence)
        self.exit_code = exit_code


def validate(rig: str, scene: str | None, overrides: Sequence[str]) -> None:
    """Refuse a rig, scene or override that a process of the rig would refuse.

    Raises RefusedError: one sentence that names the option.
    """
    fingerprint, memory = _fingerprint(rig, scene, overrides), cache_directory() / "sound-options"
    with suppress(OSError):
        if fingerprint in complete_lines(memory):
            return
    _check(json.dumps([rig, scene, list(overrides)]))
    if fingerprint:
        with suppress(OSError):
            make_folders(memory.parent)
            lines = [*complete_lines(memory), fingerprint][-_REMEMBERED:]
            with atomic_file(memory) as half:
                half.write_text("".join(f"{line}\n" for line in lines))


def _fingerprint(rig: str, scene: str | None, overrides: Sequence[str]) -> str:
    """Return the hash of all that is checked; empty for a scene with a surface file, which may change unseen."""
    try:
        loaded = config.load_rig(rig, overrides)
        of_scene = config.read_scene(scene or loaded.scene, config.split_overrides(overrides)[1])
    except ConfigError:
        return ""
    if "mesh_file" in json.dumps(of_scene, default=str):
        return ""
    said = json.dumps([rig, scene, list(overrides), loaded.model_dump(mode="json"), of_scene], default=str)
    digest = hashlib.sha256(said.encode())
    for path in sorted((*config.config_directory().glob("devices/*.yaml"), *Path(__file__).parents[1].rglob("*.py"))):
        status = path.stat()
        digest.update(f"{path} {status.st_size} {status.st_mtime_ns}".encode())
    return digest.hexdigest()


def _check(options: str) -> None:
    ran = subprocess.run(
        [sys.executable, "-m", "trocar.services.cli.check_options", options],
        stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False,
    )  # fmt: skip
    if ran.returncode:
        raise RefusedError(ran.stderr.strip(), ran.returncode)
