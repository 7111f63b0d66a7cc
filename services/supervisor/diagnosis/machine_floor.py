"""The share of its ticks that a loop loses to the machine alone, as the sleepers above all loops see it.

While the host has stopped a core, the processor time of the thread that worked there goes on, and its tick looks like
one that worked for too long; after a stall the first ticks work with cold caches. Who sleeps on that core meets a stall
with the same probability.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import trocar.protocol.bodies as bodies
from trocar.services.runtime.measures.flight import SECONDS
from trocar.services.supervisor.diagnosis.lateness_floor import CoreLateness, scheduling_classes, take_rings

#: Half of what a ring keeps.
_LOOK_S = SECONDS / 2.0


class MachineFloor:
    """Reads the rings of the sleepers in `directory`; without one, or without sleepers, every share is zero."""

    def __init__(self, directory: Path | None = None) -> None:
        self._directory = directory
        self._cores: dict[int, CoreLateness] = {}
        self._shares: dict[int, float] = {}
        self._looked_s = float("-inf")

    def look(self, now_s: float) -> None:
        """Read what is new, if that is due."""
        if self._directory is None or now_s - self._looked_s < _LOOK_S:
            return
        self._looked_s = now_s
        take_rings(self._directory, self._cores, now_s)
        for number, core in self._cores.items():
            lately = core.row().lately
            self._shares[number] = lately.late / max(lately.total, 1)

    def share(self, core: int | None) -> float:
        """Return the share of wake-ups on a core, of the last minute, that were late by more than a tick."""
        return 0.0 if core is None else self._shares.get(core, 0.0)


def below_sleepers(heard: Mapping[str, bodies.Health]) -> set[str]:
    """Return the processes with SCHED_FIFO; none beside loops with SCHED_DEADLINE, which go first and keep to no core.

    Where neither is granted, the sleepers are ordinary threads, and wake late for many reasons.
    """
    classes = scheduling_classes(heard)
    return set() if "DEADLINE" in classes.values() else {name for name, each in classes.items() if each == "FIFO"}
