"""How long each rung of the quality ladder was in force, and which ticks each loop lost meanwhile.

A run in which the governor acts is two or more: what was lost before it acted says how slow it is, what was lost
after it how much that helped. Reports come a tenth of a second apart, so a change is known as exactly.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import protocol.bodies as bodies
from services.supervisor.governor import Level
from services.supervisor.window import Tally


@dataclass(slots=True)
class Stay:
    """One stay at a rung, from and to which second, and what every process counted in it."""

    level: int
    name: str
    start_s: float
    end_s: float
    tallies: dict[str, Tally]

    def body(self, origin_s: float) -> dict[str, Any]:
        """Return it for a report, its start counted from `origin_s`."""
        counts = {name: tally.counts().loop for name, tally in self.tallies.items()}
        return {
            "level": self.level,
            "name": self.name,
            "start_s": round(self.start_s - origin_s, 3),
            "seconds": round(self.end_s - self.start_s, 3),
            "loops": {
                name: {"ticks": loop.ticks, "misses": loop.misses, "skipped": loop.skipped}
                for name, loop in counts.items()
                if loop is not None
            },
        }


class Stays:
    """The stays of a run, one after the other; a rung that is taken twice has two."""

    def __init__(self) -> None:
        self._stays: list[Stay] = []
        self._newest: dict[str, bodies.Health] = {}

    def turn(self, now_s: float, level: int, rung: Level) -> None:
        """Take note of the rung in force."""
        if self._stays:
            self._stays[-1].end_s = now_s
        if not self._stays or self._stays[-1].level != level:
            tallies = {name: Tally(health) for name, health in self._newest.items()}
            self._stays.append(Stay(level, rung.name, now_s, now_s, tallies))

    def add(self, health: bodies.Health) -> None:
        """Take a process' report."""
        self._newest[health.process] = health
        if self._stays:
            tallies = self._stays[-1].tallies
            tallies.setdefault(health.process, Tally(None)).add(health)

    def begin(self, reports: Iterable[bodies.Health]) -> None:
        """Begin to count after these reports."""
        self._newest = {health.process: health for health in reports}

    def bodies(self) -> list[dict[str, Any]]:
        """Return the stays of a report, from the first one's start on."""
        return [stay.body(self._stays[0].start_s) for stay in self._stays]
