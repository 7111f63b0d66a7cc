"""Journals: what instructors did, a line of JSON each."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec


class Journal:
    """A file of acts, to which lines are only added.

    Attributes:
        path: Path. The file, which the first act makes.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def write(self, act: Mapping[str, object]) -> None:
        """Add an act, with the time of now."""
        self.path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        with self.path.open("ab") as file:
            file.write(msgspec.json.encode({"at_ns": time.time_ns(), **act}) + b"\n")

    def last(self, most: int = 200) -> list[Any]:
        """Return the last acts, the newest first."""
        if not self.path.is_file():
            return []
        lines = self.path.read_bytes().splitlines()[-most:]
        return [msgspec.json.decode(line) for line in reversed(lines)]
