"""Progress of the 1 kHz loops, read from the row counts of their flight rings.

Reading a count costs the loop nothing. Sampling each stream fifty times a second would cost its publisher a further
reader, both bus threads their wake-ups, and the supervisor 5 % of a core.
"""

from __future__ import annotations

import os
from pathlib import Path

from trocar.services.runtime.measures.flight import SUFFIX
from trocar.services.runtime.measures.flights import open_ring, rows_written


class _Ring:
    """The ring of one process; `descriptor` is None if it cannot be read."""

    def __init__(self, path: Path, pid: int) -> None:
        self.pid = pid
        self.descriptor = open_ring(path, pid)
        self._path = path
        self._seen: int | None = None

    def is_replaced(self) -> bool:
        """Return whether another ring has its name, of a new process with the same id, as happens in containers."""
        assert self.descriptor is not None
        try:
            return os.stat(self._path).st_ino != os.fstat(self.descriptor).st_ino
        except FileNotFoundError:
            return False

    def has_grown(self) -> bool:
        """Return whether rows were written since the last call; False at the first."""
        assert self.descriptor is not None
        seen, self._seen = self._seen, rows_written(self.descriptor)
        return seen is not None and self._seen != seen

    def close(self) -> None:
        if self.descriptor is not None:
            os.close(self.descriptor)


class LoopProgress:
    """The rings in `directory`; None if rings are invisible, as those of another container."""

    def __init__(self, directory: Path | None) -> None:
        self._directory = directory
        self._rings: dict[str, _Ring] = {}

    def ticked(self, name: str, pid: int) -> bool | None:
        """Return whether the loop of process `name` has ticked since the last call; None without a ring.

        Call it only for processes that have reported ready, whose ring exists by then, or never.
        """
        if self._directory is None:
            return None
        ring = self._rings.get(name)
        if ring is None or ring.pid != pid:
            ring = self._open(name, pid)
        if ring.descriptor is None:
            return None
        grown = ring.has_grown()
        if not grown and ring.is_replaced():
            self._open(name, pid)
        return grown

    def _open(self, name: str, pid: int) -> _Ring:
        assert self._directory is not None
        if name in self._rings:
            self._rings[name].close()
        ring = self._rings[name] = _Ring(self._directory / f"{name}{SUFFIX}", pid)
        return ring

    def close(self) -> None:
        """Close the files."""
        for ring in self._rings.values():
            ring.close()
        self._rings.clear()
