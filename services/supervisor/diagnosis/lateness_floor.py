"""The lateness floor: lateness of the machine's wake-ups of a thread above all others, on each core."""

from __future__ import annotations

import subprocess
import sys
from collections import deque
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

import trocar.protocol.bodies as bodies
from trocar.services.runtime.measures.flight import SUFFIX
from trocar.services.runtime.measures.flights import read_ring, read_rings
from trocar.services.runtime.measures.histogram import LatencyHistogram
from trocar.services.supervisor.diagnosis.core_sleepers import NAME, PHASES, Phases
from trocar.services.supervisor.diagnosis.observer import RigSight, Row
from trocar.services.supervisor.diagnosis.wakeup_phase import idle_phase_ns
from trocar.services.supervisor.judge.figures import Latencies

#: A wake-up this late would have cost a 1 kHz loop its tick.
LATE_NS = 1_000_000
#: Averaging time of shares; at a hundred wake-ups a second, fewer seconds mean little.
WINDOW_S = 60.0
_END_S = 1.0
#: Silence after which the process, which writes a hundred times a second, is restarted, and most restarts.
_SILENT_S, _STARTS = 10.0, 5
#: Period of choosing phases, as a restarted gateway has another grid.
_CHOOSE_EVERY_S = 2.0


@dataclass(slots=True)
class CoreLateness:
    """Lateness of wake-ups on one core."""

    counts: LatencyHistogram = field(default_factory=lambda: LatencyHistogram(LATE_NS))
    kept: deque[tuple[float, Latencies]] = field(default_factory=deque)
    seen_ns: int = 0

    def take(self, path: Path, now_s: float, *, without_waits: bool = False) -> None:
        """Count the new rows of the ring at `path`.

        A sleeper that wakes several periods late skips the wake-ups between: each is counted, a period less late.
        With `without_waits` the time for which a sleeper with a priority waited for other threads does not count.
        """
        flight = read_ring(path)
        if flight is None:
            return
        due, woke = flight.column("due_ns"), flight.column("began_ns")
        new = woke > self.seen_ns
        late = np.maximum(0, woke - due - (flight.column("ran_ns") if without_waits else 0))
        for latest in late[new].tolist():
            for lateness in range(latest, -1, -round(flight.period_ns)):
                self.counts.record(lateness)
        self.seen_ns = int(woke.max(initial=self.seen_ns))
        self.kept.append((now_s, Latencies.of(self.counts.body())))
        while len(self.kept) > 2 and now_s - self.kept[1][0] >= WINDOW_S:
            self.kept.popleft()

    def row(self) -> Row[Latencies, Latencies]:
        """Return the counts since the start and of about the last minute."""
        total = Latencies.of(self.counts.body())
        return Row(total, self.kept[-1][1] - self.kept[0][1] if self.kept else total)


def take_rings(directory: Path, cores: dict[int, CoreLateness], now_s: float, *, without_waits: bool = False) -> None:
    """Count the new rows of every sleeper's ring in `directory`, by core."""
    for path in sorted(directory.glob(f"{NAME}[0-9]*{SUFFIX}")):
        number = int(path.name.removeprefix(NAME).removesuffix(SUFFIX))
        cores.setdefault(number, CoreLateness()).take(path, now_s, without_waits=without_waits)


class LatenessFloor:
    """Runs the process of `core_sleepers` while it is open and reads its rings."""

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        self._phases = Phases(directory / PHASES, create=True)
        self._choose_s = 0.0
        self._cores: dict[int, CoreLateness] = {}
        self._seen: list[int] = []
        self._seen_s = self._starts = 0.0
        self.said = ""
        self._process = self._started()

    def _started(self) -> subprocess.Popen[bytes]:
        self._starts += 1
        command = [sys.executable, "-m", "trocar.services.supervisor.diagnosis.core_sleepers", str(self._directory)]
        return subprocess.Popen(command, stdin=subprocess.DEVNULL)

    def sample(self, sight: RigSight) -> None:
        """Count new rows; now and then choose the phases of wake-ups that disturb the rig least."""
        if sight.now_s >= self._choose_s:
            self._choose_s = sight.now_s + _CHOOSE_EVERY_S
            self._choose_phases()
        below_loops = has_deadline_loops(sight.heard)  # which used the sleepers' cores then
        take_rings(self._directory, self._cores, sight.now_s, without_waits=below_loops)
        self._watch(sight.now_s)

    def _watch(self, now_s: float) -> None:
        """Restart the process if it has ended or writes no more."""
        seen = [core.seen_ns for core in self._cores.values()]
        if seen != self._seen or not self._seen_s:
            self._seen, self._seen_s = seen, now_s
        elif now_s - self._seen_s > _SILENT_S and self._starts <= _STARTS:
            ended = self._process.poll() is not None
            self._process.kill()
            self._process.wait()
            self.said = f"the floor's watcher {'ended' if ended else 'hangs'}: started again"
            self._process, self._seen_s = self._started(), now_s

    def report(self) -> dict[int, Row[Latencies, Latencies]]:
        """Return the lateness of wake-ups, by core."""
        return {number: core.row() for number, core in sorted(self._cores.items())}

    def _choose_phases(self) -> None:
        flights = read_rings(self._directory)
        for core in self._cores:
            phase_ns = idle_phase_ns(flights, core)
            if phase_ns is not None:
                self._phases[core] = phase_ns

    def close(self) -> None:
        """End the process."""
        (self._directory / PHASES).unlink(missing_ok=True)
        self._process.kill()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(_END_S)


def has_deadline_loops(heard: Mapping[str, bodies.Health]) -> bool:
    """Return whether loops of the rig have SCHED_DEADLINE, which precedes every priority."""
    return "DEADLINE" in scheduling_classes(heard).values()


def scheduling_classes(heard: Mapping[str, bodies.Health]) -> dict[str, str]:
    """Return the granted scheduling class of each process, as the first word of what it had."""
    facts = ((name, fact) for name, health in heard.items() for fact in health.realtime if fact.name == "scheduling")
    return {name: fact.had.partition(" ")[0] for name, fact in facts}
