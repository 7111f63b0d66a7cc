"""What `trocar up` shows: progress while the rig starts, the address, warnings."""

from __future__ import annotations

import contextlib
import os
import sys
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    ProgressColumn,
    SpinnerColumn,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
)
from rich.table import Column

import trocar.protocol.bodies as bodies
from trocar.services.runtime import log
from trocar.services.supervisor.control.supervisor import Supervisor
from trocar.services.supervisor.judge.state_machine import RigState

_STYLES = {"warning": "yellow", "error": "red"}


def _columns() -> tuple[ProgressColumn, ...]:
    """Return the columns of a bar: what a process does now is cut off where a line of the terminal ends."""
    rest = Column(ratio=1, no_wrap=True, overflow="ellipsis")
    return (
        SpinnerColumn(),
        TextColumn("{task.fields[process]}"),
        BarColumn(bar_width=16),
        TextColumn("{task.fields[percent]:>3}%"),
        TextColumn("{task.description}", table_column=rest),
        TimeElapsedColumn(),
    )


class StatusDisplay:
    """Standard error for people, on a terminal with bars; elsewhere one line per change.

    Without bars the address is told at once on standard output: a first start compiles for a minute, and what goes to
    standard error of one that fails is one sentence.
    """

    def __init__(self) -> None:
        self._console = Console(stderr=True, highlight=False, soft_wrap=True)
        self._bars = Progress(*_columns(), console=self._console, transient=True, expand=True)
        self._tasks: dict[str, TaskID] = {}
        self._state: RigState | None = None
        self._shown = False
        self._announced = self._told_start = False
        self._level = log.asked_level()

    def __enter__(self) -> Self:
        if self._console.is_terminal:
            self._bars.start()
            self._shown = True
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._end_bars()

    def event(self, event: bodies.Event) -> None:
        """Show a line that is worth a person's eye."""
        if self._level is not None:
            shown = log.LEVELS[event.level] >= self._level
        else:
            shown = event.level in _STYLES or (event.level == "info" and (self._console.is_terminal or self._announced))
        if shown:
            self._console.print(f"{event.t:7.2f} s  {event.text}", style=_STYLES.get(event.level), markup=False)

    def show_state(self, supervisor: Supervisor) -> None:
        """Follow the rig."""
        if self._shown:
            self._show_progress(supervisor)
        elif not self._told_start and not self._announced:
            self._tell_start(supervisor)
        if supervisor.state is not self._state:
            self._state = supervisor.state
            if self._state is RigState.RUNNING:
                self._end_bars()
                if not self._announced:
                    self._announce(supervisor)

    def _tell_start(self, supervisor: Supervisor) -> None:
        self._told_start = True
        if supervisor.page_address and sys.stdout is not None:
            said = f"the rig {supervisor.rig.name!r} is starting: open {supervisor.page_address}\n"
            said += f"{supervisor.start_notice}\n" if supervisor.start_notice else ""
            with contextlib.suppress(OSError):  # nobody reads it any more, which is no reason to end the rig
                os.write(sys.stdout.fileno(), said.encode())  # past the buffer, which would fail again in the end

    def _announce(self, supervisor: Supervisor) -> None:
        self._announced = True
        page = supervisor.page_address
        said = f"the rig {supervisor.rig.name!r} is running: open {page} (Ctrl-C ends it)"
        self._console.print(said, markup=False)
        sys.stderr.flush()

    def _show_progress(self, supervisor: Supervisor) -> None:
        for name, member in supervisor.crew.members.items():
            if name not in self._tasks:
                self._tasks[name] = self._bars.add_task("", process=name, percent=0, total=1.0)
            stage, fraction = member.progress or (str(member.state), None)
            if member.up:
                stage, fraction = "ready", 1.0
            done = fraction or 0.0
            self._bars.update(self._tasks[name], description=stage, completed=done, percent=int(100.0 * done))

    def _end_bars(self) -> None:
        if self._shown:
            self._bars.stop()
            self._shown = False
