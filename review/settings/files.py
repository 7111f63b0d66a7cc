"""The files of a configuration folder: listed, read, checked, and written as a whole and only when they are sound."""

from __future__ import annotations

import hashlib
import json
import os
import re
import threading
from pathlib import Path
from typing import Any, NamedTuple

from trocar.review.settings.checking import last_line, run_check
from trocar.services.files.atomic_file import atomic_file
from trocar.services.runtime.config import config
from trocar.services.runtime.errors import ConfigError

KINDS = ("rig", "scene", "device")
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")


class Text(NamedTuple):
    """A file's text, and what it is known by: what is written later is based on it."""

    text: str
    mark: str


class ConfigurationFiles:
    """Rigs, scenes and devices of the configuration folder.

    Args:
        folder: The folder; None for the one that `trocar` uses.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._folder = folder
        self._lock = threading.Lock()

    def names(self) -> dict[str, list[str]]:
        """Return the files' bare names by kind. Raises ConfigError if there is no folder."""
        return {kind: sorted(path.stem for path in self._of(kind).glob("[!.]*.yaml")) for kind in KINDS}

    def read(self, kind: str, name: str) -> Text:
        """Return a file's text. Raises ConfigError if there is none, or it lies elsewhere."""
        path = self.path(kind, name)
        try:
            text = path.read_bytes().decode()
        except FileNotFoundError:
            raise ConfigError(f"there is no {kind} {name!r} in {path.parent}") from None
        except (OSError, UnicodeDecodeError) as error:
            raise ConfigError(f"{path}: {getattr(error, 'strerror', None) or 'is not UTF-8 text'}") from None
        return Text(text, _mark(text))

    def path(self, kind: str, name: str) -> Path:
        """Return where a file is, or would be. Raises ConfigError for a place outside of the folder."""
        if kind not in KINDS:
            raise ConfigError(f"there is no kind of file {kind[:64]!r}; known: {', '.join(KINDS)}")
        if not _NAME.fullmatch(name):
            raise ConfigError(f"{name[:64]!r} is no name of a file: letters, digits, - and _ make one")
        path = self._of(kind) / f"{name}.yaml"
        if self._root().resolve() not in path.resolve().parents:
            raise ConfigError(f"{path}: leads out of the configuration folder")
        return path

    def check(self, kind: str, name: str, text: str) -> list[dict[str, Any]]:
        """Return the rows of a text that would be the file.

        Raises ConfigError: one sentence that names the file and the key.
        """
        path = self.path(kind, name)
        draft = path.with_name(f".{os.getpid()}.{name}.yml")  # beside it, as it may name others by their place
        with self._lock:
            try:
                draft.write_bytes(text.encode())
                return _rows(kind, draft, path)
            except OSError as error:
                raise ConfigError(f"{path.parent}: {(error.strerror or str(error)).lower()}") from None
            finally:
                draft.unlink(missing_ok=True)

    def save(self, kind: str, name: str, text: str, mark: str) -> tuple[str, list[dict[str, Any]]]:
        """Write a file that is sound; `mark` is of the text that it was made from, empty for a new file.

        Returns the new mark and the rows. Raises ConfigError, and leaves the file as it is, if it is not sound or was
        changed meanwhile.
        """
        path = self.path(kind, name)
        self._refuse_other(path, mark)
        rows = self.check(kind, name, text)
        with self._lock:
            self._refuse_other(path, mark)
            try:
                with atomic_file(path) as half:
                    half.write_bytes(text.encode())
            except OSError as error:
                raise ConfigError(f"{path}: {(error.strerror or str(error)).lower()}") from None
        return _mark(text), rows

    def _refuse_other(self, path: Path, mark: str) -> None:
        if not path.exists():
            if mark:
                raise ConfigError(f"{path.name} is not there any more: save it under a new name")
        elif not mark:
            raise ConfigError(f"{path.name} is there already: choose another name")
        elif _mark(path.read_bytes().decode(errors="replace")) != mark:
            raise ConfigError(f"{path.name} has been changed by somebody else: open it again")

    def _root(self) -> Path:
        return self._folder or config.config_directory()

    def _of(self, kind: str) -> Path:
        return self._root() / f"{kind}s"


def _mark(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def _rows(kind: str, draft: Path, path: Path) -> list[dict[str, Any]]:
    """Return the rows of a draft; a refusal names the file that it is to be."""
    ran = run_check("trocar.review.settings.rows", kind, str(draft))
    if ran.returncode:
        raise ConfigError(_renamed(ran.stderr, draft, path) or f"{path.name}: the check ended with {ran.returncode}")
    found: list[dict[str, Any]] = json.loads(ran.stdout)
    return found


def _renamed(told: str, draft: Path, path: Path) -> str:
    """Return the last sentence of a check with the file's own name in the draft's place."""
    return re.sub(rf"(--\w+ )?{re.escape(str(draft))}", path.name, last_line(told))
