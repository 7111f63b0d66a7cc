"""Keeping the machine's floor: its process, and how late it woke on each core, as the page shows it."""

from __future__ import annotations

import subprocess
import sys
from collections import deque
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from services.runtime.flight import SUFFIX
from services.runtime.flights import read_ring, read_rings
from services.runtime.histogram import LatencyHistogram
from services.supervisor import floor
from services.supervisor.figures import Latencies
from services.supervisor.quiet import quiet_phase_ns

#: A wake-up so late would have cost a loop of 1 kHz its tick.
LATE_NS = 1_000_000
#: Over which shares are shown: at a hundred wake-ups a second, fewer seconds say little.
WINDOW_S = 60.0
_END_S = 1.0
#: A gateway that was started anew has another grid.
_LOOK_EVERY_S = 2.0


@dataclass(slots=True)
class Core:
    """How late wake-ups were on one core. `realtime` says whether it wakes before everybody else."""

    number: int
    counts: LatencyHistogram = field(default_factory=lambda: LatencyHistogram(LATE_NS))
    kept: deque[tuple[float, Latencies]] = field(default_factory=deque)
    seen_ns: int = 0

    def take(self, path: Path, now_s: float, *, below_loops: bool = False) -> None:
        """Count what the ring at `path` has that was not seen.

        With `below_loops` the time in which a watcher with a priority waited for its core does not count: the rig's
        loops had it.
        """
        flight = read_ring(path)
        if flight is None:
            return
        due, woke = flight.column("due_ns"), flight.column("began_ns")
        new = woke > self.seen_ns
        late = np.maximum(0, woke - due - flight.column("ran_ns")) if below_loops else woke - due
        for lateness in late[new].tolist():
            self.counts.record(lateness)
        self.seen_ns = int(woke.max(initial=self.seen_ns))
        self.kept.append((now_s, Latencies.of(self.counts.body())))
        while len(self.kept) > 2 and now_s - self.kept[1][0] >= WINDOW_S:
            self.kept.popleft()

    def recent(self) -> Latencies:
        """Return the counts of about the last minute."""
        return self.kept[-1][1] - self.kept[0][1] if self.kept else Latencies.of(self.counts.body())


class FloorWatch:
    """The floor's process while it is open, and its figures. It never holds anybody up."""

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        self._phases = floor.Phases(directory / floor.PHASES, create=True)
        self._look_s = 0.0
        self._process = subprocess.Popen(
            [sys.executable, "-m", "services.supervisor.floor", str(directory)], stdin=subprocess.DEVNULL
        )
        self.cores: dict[int, Core] = {}

    def turn(self, now_s: float, *, below_loops: bool = False) -> None:
        """Count what has come; now and then find out when looking costs the rig least."""
        if now_s >= self._look_s:
            self._look_s = now_s + _LOOK_EVERY_S
            self._choose_phases()
        for path in sorted(self._directory.glob(f"{floor.NAME}[0-9]*{SUFFIX}")):
            number = int(path.name.removeprefix(floor.NAME).removesuffix(SUFFIX))
            self.cores.setdefault(number, Core(number)).take(path, now_s, below_loops=below_loops)

    def _choose_phases(self) -> None:
        flights = read_rings(self._directory)
        for core in self.cores:
            phase_ns = quiet_phase_ns(flights, core)
            if phase_ns is not None:
                self._phases[core] = phase_ns

    def close(self) -> None:
        """End the process."""
        (self._directory / floor.PHASES).unlink(missing_ok=True)
        self._process.kill()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(_END_S)
