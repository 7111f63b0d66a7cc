"""Pictures of attempts for their replay, one compressed file each, as the page that saw them has kept them."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from pathlib import Path

from trocar.review.attempts.store.database import default_url
from trocar.services.files.atomic_file import atomic_file
from trocar.services.runtime.errors import UserError

MOST_BYTES = 64 << 20  # assumption: no replay of some minutes has as much
_NAME = re.compile(r"[0-9A-Za-z-]{1,64}")


def folder_of(database: str | None) -> Path:
    """Return where the replays of a database are: beside a file of SQLite, else in this user's data."""
    url = database or default_url()
    if "://" not in url:
        return Path(url).with_suffix(".replays")
    if url.startswith("sqlite:///"):
        return Path(url.removeprefix("sqlite:///")).with_suffix(".replays")
    data = Path(os.environ.get("XDG_DATA_HOME") or Path.home() / ".local/share") / "trocar"
    return data / "replays"


class Replays:
    """The files of a folder, which is made with the first of them."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def path(self, attempt_id: str) -> Path:
        """Return the file of an attempt. Raises UserError if no attempt can be called so."""
        if not _NAME.fullmatch(attempt_id):
            raise UserError(f"{attempt_id!r} is no attempt")
        return self._folder / f"{attempt_id}.view"

    def picture(self, attempt_id: str) -> Path:
        """Return the file of an attempt's last picture."""
        return self.path(attempt_id).with_suffix(".jpg")

    def cholangiogram(self, attempt_id: str) -> Path:
        """Return the file of the cholangiogram of an attempt's end."""
        return self.path(attempt_id).with_suffix(".cholangiogram")

    def keep_picture(self, attempt_id: str, data: bytes) -> None:
        """Keep the last picture of an attempt; the first one counts."""
        path = self.picture(attempt_id)
        if not path.exists():
            self._folder.mkdir(parents=True, exist_ok=True, mode=0o700)
            with atomic_file(path) as half:
                half.write_bytes(data)

    def has(self, attempt_id: str) -> bool:
        """Return whether an attempt has a replay."""
        return bool(attempt_id) and self.path(attempt_id).is_file()

    def keep(self, attempt_id: str, data: bytes) -> None:
        """Keep the replay of an attempt; the first one counts."""
        path = self.path(attempt_id)
        if path.exists():
            return
        self._folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        with atomic_file(path) as half:
            half.write_bytes(data)

    def erase(self, attempt_ids: Iterable[str]) -> None:
        """Remove the replays of attempts."""
        for each in attempt_ids:
            if each:
                self.path(each).unlink(missing_ok=True)
                self.picture(each).unlink(missing_ok=True)
                self.cholangiogram(each).unlink(missing_ok=True)
