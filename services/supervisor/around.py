"""What is to be seen beside the rig itself: the machine's floor, the threads' times, the flights of missed ticks."""

from __future__ import annotations

import asyncio
import os
import sys
import time
from collections.abc import Mapping
from pathlib import Path

import protocol.bodies as bodies
from services.runtime import endpoints
from services.runtime.errors import BusError
from services.runtime.flight import flight_directory
from services.runtime.rig import Rig
from services.supervisor.dashboard import Surroundings
from services.supervisor.figures import Latencies
from services.supervisor.flight_files import FlightFiles
from services.supervisor.floor_watch import FloorWatch
from services.supervisor.notes import Notes
from services.supervisor.threads import ThreadWatch

#: Of the rig: only then is a process that is down worth a flight.
_AT_WORK = ("running", "degraded")


class Around:
    """Looks around for the page's process. Where something cannot be had it is left out, and said in the log."""

    def __init__(self, rig: Rig) -> None:
        self.threads = ThreadWatch()
        self._floor: FloorWatch | None = None
        self._files: FlightFiles | None = None
        self._writing: asyncio.Task[Path] | None = None
        try:
            run_directory = endpoints.run_directory(rig.transport)
            rings = flight_directory(run_directory)
            self._files = FlightFiles(rings, run_directory / "flights")
            if rig.supervisor.watch_floor:
                self._floor = FloorWatch(rings)
        except (BusError, OSError) as error:
            print(f"neither flights nor floor: {error}", file=sys.stderr)  # noqa: T201

    async def turn(self, notes: Notes, heard: Mapping[str, bodies.Health]) -> None:
        """Look; what is to be written is written by a thread."""
        now_s = time.monotonic()
        pids = {member.name: member.pid for member in notes.members}
        self.threads.turn(now_s, {**pids, "supervisor": os.getppid()})
        if self._floor is not None:
            self._floor.turn(now_s, below_loops=stand_above_all(heard))
        if self._files is None or (self._writing is not None and not self._writing.done()):
            return
        down = {m.name: m.reason or m.state for m in notes.members if not m.up and notes.state in _AT_WORK}
        reason = self._files.look(now_s, heard, down)
        if reason:
            threads = self.threads.recent()
            self._writing = asyncio.create_task(asyncio.to_thread(self._files.write, reason, threads))

    def floor(self) -> dict[int, Latencies]:
        """Return how late the machine woke on each core since it was watched."""
        cores = self._floor.cores.values() if self._floor is not None else ()
        return {core.number: Latencies.of(core.counts.body()) for core in cores}

    def shown(self) -> Surroundings:
        """Return what the page shows."""
        cores = self._floor.cores.values() if self._floor is not None else ()
        floor = {core.number: core.recent() for core in cores}
        return Surroundings(floor, self.threads.usage(), self._files.last if self._files is not None else "")

    def close(self) -> None:
        """End what was started."""
        if self._floor is not None:
            self._floor.close()


def stand_above_all(heard: Mapping[str, bodies.Health]) -> bool:
    """Return whether loops of the rig come before any thread with a priority: those that have SCHED_DEADLINE."""
    facts = (fact for health in heard.values() for fact in health.realtime)
    return any(fact.name == "scheduling" and fact.had.startswith("DEADLINE") for fact in facts)
