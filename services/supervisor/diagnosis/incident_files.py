"""Incident files: after a missed tick or the loss of a process, the last seconds of every loop in one file."""

from __future__ import annotations

import os
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path

import trocar.protocol.bodies as bodies
from trocar.services.runtime.measures.flights import (
    FAST_HZ,
    FILE_SUFFIX,
    Flights,
    ThreadTime,
    read_rings,
    to_bytes,
    worst_ns,
)
from trocar.services.runtime.private_directory import make_private, open_private
from trocar.services.supervisor.diagnosis.observer import RigSight, Row

#: Delay of writing after a miss, to include what follows; rings hold two seconds.
_AFTERMATH_S = 0.5
#: Shortest time between files. Of all files of a rig the newest are kept, and those with the worst ticks.
APART_S = 10.0
NEWEST, WORST = 10, 10


class IncidentFiles:
    """Decides when to write, and writes in a thread, as disks may be slow.

    Args:
        rings, directory: Directories of the flight rings and of the files.
        busiest: Returns the threads that ran recently.
    """

    def __init__(
        self, rings: Path, directory: Path, busiest: Callable[[], tuple[ThreadTime, ...]] = lambda: ()
    ) -> None:
        self._rings = rings
        self.directory = make_private(directory)
        self._busiest = busiest
        self._written: deque[Path] = deque(maxlen=NEWEST)  # by order of writing, as clocks may be set back
        self._n_written = 0
        self._writing: threading.Thread | None = None
        self._misses: dict[tuple[str, int], int] = {}
        self._reason = ""
        self._wanted_s = 0.0
        self._written_s = float("-inf")

    def sample(self, sight: RigSight) -> None:
        """Write a file if there is a reason."""
        if self._writing is not None and self._writing.is_alive():
            return
        reason = self.reason_to_write(sight.now_s, sight.heard, sight.down)
        if reason:
            self._writing = threading.Thread(target=self.write, args=(reason, self._busiest()))
            self._writing.start()

    def report(self) -> dict[str, Row[int, str]]:
        """Return the number of files and the name of the last; empty before the first."""
        return {"files": Row(self._n_written, self._written[-1].name)} if self._written else {}

    def reason_to_write(self, now_s: float, heard: Mapping[str, bodies.Health], down: Mapping[str, str]) -> str:
        """Process reports and processes that are down; return the reason to write a file now, or ""."""
        for name, health in heard.items():
            loop = health.loop
            if loop is None or loop.rate_hz < FAST_HZ:
                continue
            known = self._misses.get((name, health.pid))
            self._misses[name, health.pid] = loop.misses
            if known is not None and loop.misses > known:
                self._want(now_s, f"{name}: {loop.misses - known} ticks missed")
        for name, why in down.items():
            self._want(now_s, f"{name}: {why}")
        if not self._reason or now_s - self._wanted_s < _AFTERMATH_S or now_s - self._written_s < APART_S:
            return ""
        reason, self._reason, self._written_s = self._reason, "", now_s
        return reason

    def _want(self, now_s: float, reason: str) -> None:
        if not self._reason:
            self._reason, self._wanted_s = reason, now_s

    def write(self, reason: str, threads: tuple[ThreadTime, ...]) -> Path:
        """Write the present rings into a file and return it. Its name contains the lateness of the worst tick."""
        now = datetime.now(UTC)
        flights = read_rings(self._rings)
        data = to_bytes(Flights(flights, time.monotonic_ns(), now.isoformat(timespec="seconds"), reason, threads))
        late_us = round(worst_ns(flights, FAST_HZ) / 1e3)
        path = self.directory / f"{now:%Y%m%d-%H%M%S}-late-{late_us:08d}us{FILE_SUFFIX}"
        with os.fdopen(open_private(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), "wb") as file:
            file.write(data)
        self._n_written += 1
        self._written.append(path)
        self._prune()
        return path

    def close(self) -> None:
        """Wait for the file being written."""
        if self._writing is not None:
            self._writing.join()

    def _prune(self) -> None:
        files = sorted(self.directory.glob(f"*-late-*us{FILE_SUFFIX}"), reverse=True)
        worst = sorted(files, key=lambda path: path.name.rpartition("-")[2], reverse=True)
        for path in set(files) - set(files[:NEWEST]) - set(worst[:WORST]) - set(self._written):
            path.unlink(missing_ok=True)
