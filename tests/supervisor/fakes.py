"""A rig of fake processes on the real bus, and what a scenario of it waits for."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from tests.patience import PATIENCE_S
from trocar.services.runtime.process.process import Options
from trocar.services.supervisor import session
from trocar.services.supervisor.control.supervisor import Supervisor
from trocar.services.supervisor.crew.fork_link import ForkServer
from trocar.services.supervisor.crew.processes import TABLE, ProcessSpec
from trocar.services.supervisor.judge.state_machine import RigState

HERE = Path(__file__).parent
Scenario = Iterator[None]


@dataclass
class Fakes:
    """A rig of fake processes in a folder of its own."""

    options: Options
    fork_server: ForkServer | None = None

    def table(self, **words: str) -> tuple[ProcessSpec, ...]:
        path = os.pathsep.join((str(HERE), str(HERE.parents[1])))
        return tuple(
            replace(
                spec,
                module="fake_process",
                environment={
                    **spec.environment, "PYTHONPATH": path, "FAKE_NAME": spec.name,
                    "FAKE_WORDS": words.get(spec.name, ""),
                },
            )
            for spec in TABLE
        )  # fmt: skip

    def play(self, scenario: Callable[[Supervisor], Scenario], **words: str) -> list[str]:
        """Run the rig for as long as the scenario lasts; return the events."""
        table = self.table(**words)
        events: list[str] = []
        playing: list[Scenario] = []

        def turn(supervisor: Supervisor, _now_s: float) -> bool:
            if not playing:
                playing.append(scenario(supervisor))
            return next(playing[0], "end") == "end"

        process = session.open_session(self.options)
        try:
            options = session.SessionOptions(
                self.options, table, lambda event: events.append(event.text), turn, fork_server=self.fork_server
            )
            session.run_session(process, options)
        finally:
            process.bus.close()
        return events


def until(condition: Callable[[], bool], patience_s: float = PATIENCE_S) -> Scenario:
    deadline = time.monotonic() + patience_s
    while not condition():
        assert time.monotonic() < deadline, "it did not happen"
        yield


def until_running(supervisor: Supervisor) -> Scenario:
    yield from until(lambda: supervisor.state is RigState.RUNNING)


def gone(pid: int) -> bool:
    return not Path(f"/proc/{pid}").exists()


def page_servers() -> list[int]:
    return children("page_server")


def children(module: str) -> list[int]:
    """Return the children of this process that run a module."""
    pids = Path(f"/proc/self/task/{os.getpid()}/children").read_text().split()
    return [int(pid) for pid in pids if module.encode() in Path(f"/proc/{pid}/cmdline").read_bytes()]
