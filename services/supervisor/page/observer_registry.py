"""All observers of a rig in one table, for the page, /metrics and incident files."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass, field

import trocar.protocol.bodies as bodies
from trocar.services.runtime.bus import endpoints
from trocar.services.runtime.config.rig import Rig
from trocar.services.runtime.errors import BusError
from trocar.services.runtime.measures.flight import flight_directory
from trocar.services.supervisor.diagnosis.incident_files import IncidentFiles
from trocar.services.supervisor.diagnosis.lateness_floor import LatenessFloor
from trocar.services.supervisor.diagnosis.observer import Observer, RigSight, Row
from trocar.services.supervisor.diagnosis.thread_usage import Counts, ThreadUsage, Usage
from trocar.services.supervisor.judge.figures import Latencies
from trocar.services.supervisor.page.page_link import RigStatus

#: States of the rig in which a process that is down is an incident.
_AT_WORK = ("running", "degraded")


@dataclass(frozen=True, slots=True)
class Report:
    """The rows of all observers; one that cannot work on this host has none."""

    floor: Mapping[int, Row[Latencies, Latencies]] = field(default_factory=dict)
    threads: Mapping[str, Row[Counts, Usage | None]] = field(default_factory=dict)
    incidents: Mapping[str, Row[int, str]] = field(default_factory=dict)


class Observers:
    """All observers of a rig, by the field of `Report` that they fill."""

    def __init__(self, rig: Rig) -> None:
        threads = ThreadUsage()
        self._floor: LatenessFloor | None = None
        self._table: dict[str, Observer] = {"threads": threads}
        try:
            run_directory = endpoints.run_directory(rig.transport)
            rings = flight_directory(run_directory)
            self._table["incidents"] = IncidentFiles(rings, run_directory / "flights", threads.busiest)
            if rig.supervisor.watch_floor:
                self._table["floor"] = self._floor = LatenessFloor(rings)
        except (BusError, OSError) as error:
            print(f"neither incident files nor the machine's lateness: {error}", file=sys.stderr)  # noqa: T201

    def sample(self, status: RigStatus, heard: Mapping[str, bodies.Health]) -> None:
        """Pass the rig's judgement and its processes' reports to each observer."""
        processes = status.state.processes
        at_work = status.state.state in _AT_WORK
        pids = {process.name: process.pid for process in processes} | {"supervisor": os.getppid()}
        down = {p.name: p.reason or p.state for p in processes if at_work and p.state != "ready"}
        sight = RigSight(time.monotonic(), pids, heard, down)
        for observer in self._table.values():
            observer.sample(sight)

    def said(self) -> str:
        """Return a fault of the observers' processes, once; mostly empty."""
        if self._floor is None:
            return ""
        said, self._floor.said = self._floor.said, ""
        return said

    def report(self) -> Report:
        """Return the rows of all observers."""
        return Report(**{name: observer.report() for name, observer in self._table.items()})

    def close(self) -> None:
        """Close all observers."""
        for observer in self._table.values():
            observer.close()
