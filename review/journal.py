"""Journals: what instructors did, a line of JSON each."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

import msgspec


class ActJournal:
    """A file of acts, to which lines are only added.

    Attributes:
        path: Path. The file, which the first act makes.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def write(self, act: Mapping[str, object]) -> None:
        """Add an act, with the time of now."""
        self.path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        with self.path.open("ab+") as file:
            begins = b"" if _ends_with_a_line(file) else b"\n"
            file.write(begins + msgspec.json.encode({"at_ns": time.time_ns(), **act}) + b"\n")

    def last(self, most: int = 200) -> list[Any]:
        """Return the last acts, the newest first, without lines that a full disk or a crash has cut."""
        if not self.path.is_file():
            return []
        lines = self.path.read_bytes().splitlines()[-most:]
        return [act for line in reversed(lines) if (act := _decoded(line)) is not None]


def _ends_with_a_line(file: BinaryIO) -> bool:
    """Return whether the file is empty or its last line is whole."""
    if file.seek(0, os.SEEK_END) == 0:
        return True
    file.seek(-1, os.SEEK_END)
    return file.read(1) == b"\n"


def _decoded(line: bytes) -> dict[str, Any] | None:
    try:
        return msgspec.json.decode(line, type=dict[str, Any])
    except msgspec.DecodeError:
        return None
