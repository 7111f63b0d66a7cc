"""One process in the supervisor: its state, its child, its newest report, and its restarts."""

from __future__ import annotations

import re
import signal
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum

import trocar.protocol.bodies as bodies
from trocar.services.runtime.config.rig import Rig
from trocar.services.supervisor.crew.launcher import Child
from trocar.services.supervisor.crew.processes import ProcessSpec
from trocar.services.supervisor.crew.restart_policy import RestartPolicy
from trocar.services.supervisor.crew.scheduler_state import Waits
from trocar.services.supervisor.crew.stall_messages import StallMessages
from trocar.services.supervisor.judge import contracts, figures
from trocar.services.supervisor.judge.window import Window

#: The gateway's report is made in parts, so that an earlier one may precede a command.
_REPORT_S = 0.2
#: Pause before an event is told again of which only the numbers have changed. The page shows the last fifty events: one
#: that lasts fills them in eight minutes, at one a second it would in less than one.
SAY_AGAIN_S = 10.0


class MemberState(StrEnum):
    """States of a process."""

    WAITING = "waiting"  # not started, or waiting for its back-off
    STARTING = "starting"
    READY = "ready"
    HUNG = "hung"  # alive, but silent or stopped
    LOST = "lost"  # died or vanished; waits for a restart, by us or its owner
    FAILED = "failed"  # given up until the rig is armed
    STOPPING = "stopping"


@dataclass(frozen=True, slots=True)
class Fault:
    """Error message and exit code of a process that ended by itself in error."""

    sentence: str
    exit_code: int


@dataclass(slots=True)
class Member:
    """A process of the rig; times are seconds of the monotonic clock."""

    spec: ProcessSpec
    critical: bool
    may_restart: bool
    restarts: RestartPolicy
    window: Window
    state: MemberState = MemberState.WAITING
    reason: str = ""
    child: Child | None = None
    due_s: float = 0.0
    since_s: float = 0.0
    health: bodies.Health | None = None
    heard_s: float = 0.0
    waited: Waits = field(default_factory=Waits)  # for a processor, up to the last report
    stream_s: float | None = None
    last_lines: list[str] = field(default_factory=list)
    progress: tuple[str, float] | None = None
    advanced_s: float = 0.0  # time of the last change of its progress
    waited_before_s: float = 0.0  # for a processor, up to then
    killed: bool = False
    status: int = 0  # its last exit status
    fault: Fault | None = None  # the last one, kept over restarts
    came_up: bool = False  # was ready since it was started
    stalls_s: list[float] = field(default_factory=list)  # ends of silences from which it recovered by itself
    stalls: StallMessages = field(default_factory=StallMessages)
    _detail_told: str = ""
    _detail_told_s: float = 0.0
    _detail_ended: bool = True

    @property
    def name(self) -> str:
        """Name on the bus."""
        return self.spec.name

    @property
    def pid(self) -> int:
        """Process id of our child, or by its own report."""
        if self.child is not None:
            return self.child.pid
        return self.health.pid if self.health else 0

    @property
    def up(self) -> bool:
        """Whether it is ready and nothing is wrong with it."""
        return self.state is MemberState.READY

    def enter(self, state: MemberState, now_s: float, reason: str = "") -> None:
        """Change the state."""
        self.state, self.since_s, self.reason = state, now_s, reason

    def hear_heartbeat(self, health: bodies.Health, now_s: float) -> bool:
        """Process a heartbeat; return whether it is from our process."""
        if self.child is not None and health.pid != self.child.pid:
            return False
        self.health, self.heard_s = health, now_s
        if self.child is not None:
            self.waited = self.child.waits()
        self.window.add(health.pid, figures.contracted(health))
        return True

    def safe_stop_said(self, asked_s: float) -> float | None:
        """Return the gateway's report of its safe stop, None if it may precede the command of `asked_s`."""
        is_newer = self.health is not None and self.heard_s >= asked_s + _REPORT_S
        return self.health.gauges.get("safe_stop") if self.health is not None and is_newer else None

    def new_detail(self, now_s: float) -> list[str]:
        """Return its new reports of faults.

        The same words with other numbers, as of a growing count, are new only after ten seconds, because a line each
        second would fill the history.
        """
        detail = self.health.detail if self.health is not None and self.health.state == "degraded" else ""
        if not detail:
            self._detail_ended = True
            return []
        if detail == self._detail_told and not self._detail_ended:
            return []
        if now_s - self._detail_told_s < SAY_AGAIN_S and _words(detail) == _words(self._detail_told):
            return []
        self._detail_told, self._detail_told_s, self._detail_ended = detail, now_s, False
        return [f"{self.name}: {detail}"]

    def starved(self) -> Waits:
        """Return our child's waits for a processor since it was last heard, or started."""
        return self.child.waits().since(self.waited) if self.child is not None else Waits()

    def advance(self, progress: tuple[str, float], now_s: float) -> None:
        """Process the progress reported by a starting process; a repetition is none."""
        if progress != self.progress:
            self.progress, self.advanced_s = progress, now_s
            self.waited_before_s = self.child.waits().total_s if self.child is not None else 0.0

    def forget_reports(self) -> None:
        """Clear the reports of the ended process."""
        self.health = None
        self.stream_s = None
        self.progress = None
        self.advanced_s = self.waited_before_s = 0.0
        self.killed = False
        self.came_up = False
        self.stalls = StallMessages()
        self.waited = Waits()

    def kill(self) -> None:
        """Kill the process, as hung processes do not react to other signals."""
        if self.child is not None:
            self.killed = True
            self.child.send(signal.SIGKILL)

    def body(self) -> bodies.ProcessReport:
        """Return the process' report for the wire."""
        return bodies.ProcessReport(
            name=self.name, state=self.state, pid=self.pid, restarts=self.restarts.count, reason=self.reason[:256]
        )


def build_members(rig: Rig, table: Sequence[ProcessSpec]) -> dict[str, Member]:
    """Return the members that `rig` runs, by name."""
    settings = rig.supervisor
    launched = settings.mode == "launch"
    return {
        spec.name: Member(
            spec=spec,
            critical=spec.critical and rig.process(spec.name).critical,
            may_restart=launched and rig.process(spec.name).restart,
            restarts=RestartPolicy(settings.backoff_s, settings.max_restarts_per_minute),
            window=Window(contracts.BUDGET_S),
        )
        for spec in table
        if rig.process(spec.name).enabled
    }


def _words(detail: str) -> list[str]:
    """Return the words of a message without numbers, sorted."""
    return sorted(re.findall(r"[^\W\d]+", detail))
