"""One process as the supervisor knows it: its state, its child, its newest report, when it may be started again."""

from __future__ import annotations

import re
import signal
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum

import protocol.bodies as bodies
from services.runtime.rig import Rig
from services.supervisor import contracts, figures
from services.supervisor.kernel_word import Waits
from services.supervisor.launcher import Child
from services.supervisor.processes import ProcessSpec
from services.supervisor.window import Window

#: The gateway's report is made in pieces: one that comes sooner may be older than a command.
_REPORT_S = 0.2
#: What a process says is wrong with it is told again so late where nothing but its numbers has changed.
_AGAIN_S = 10.0
_MINUTE_S = 60.0


class RestartPolicy:
    """Delays that grow with the restarts of the last minute, and an end to them.

    Args:
        backoff_s: Delay before the first, second, ... restart within a minute; the last holds for all further ones.
        max_per_minute: Restarts within a minute after which the process is given up.
    """

    def __init__(self, backoff_s: tuple[float, ...], max_per_minute: int) -> None:
        self._backoff_s = backoff_s or (0.0,)
        self._max = max_per_minute
        self._times_s: deque[float] = deque()
        self.count = 0

    def delay_s(self, now_s: float) -> float | None:
        """Count a restart at `now_s` and return how long to wait for it; None when the limit is reached."""
        while self._times_s and now_s - self._times_s[0] > _MINUTE_S:
            self._times_s.popleft()
        if len(self._times_s) >= self._max:
            return None
        delay = self._backoff_s[min(len(self._times_s), len(self._backoff_s) - 1)]
        self._times_s.append(now_s)
        self.count += 1
        return delay

    def forgive(self) -> None:
        """Forget the minute: a person has armed the rig anew."""
        self._times_s.clear()


class MemberState(StrEnum):
    """What a process is in."""

    WAITING = "waiting"  # not started, or waiting for its back-off
    STARTING = "starting"
    READY = "ready"
    HUNG = "hung"  # alive, but silent or stopped
    LOST = "lost"  # died or vanished; waits to be started again, or for whoever owns it
    FAILED = "failed"  # given up: only arming the rig tries again
    STOPPING = "stopping"


@dataclass(frozen=True, slots=True)
class Fault:
    """What a process said when it ended by itself and in error, and its exit code."""

    sentence: str
    exit_code: int


@dataclass(slots=True)
class Member:
    """A process of the rig. Times are seconds of the monotonic clock."""

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
    waited: Waits = field(default_factory=Waits)  # for a processor, up to when it was heard
    stream_s: float | None = None
    last_lines: list[str] = field(default_factory=list)
    progress: tuple[str, float] | None = None
    advanced_s: float = 0.0  # when it last said something else of its progress
    waited_before_s: float = 0.0  # for a processor, up to then
    killed: bool = False
    status: int = 0  # with which it last ended
    fault: Fault | None = None  # the last of all: one that was started again may have left a hole
    came_up: bool = False  # was ready since it was started
    stalls_s: list[float] = field(default_factory=list)  # when silences ended that it came back from by itself
    _stalls_told: int = 0  # index of the loop's last stall that was
    _detail_told: str = ""
    _detail_told_s: float = 0.0
    _detail_ended: bool = True

    @property
    def name(self) -> str:
        """Name on the bus."""
        return self.spec.name

    @property
    def pid(self) -> int:
        """Process id: of our child, else as it says itself."""
        if self.child is not None:
            return self.child.pid
        return self.health.pid if self.health else 0

    @property
    def up(self) -> bool:
        """Whether it is ready and nothing is wrong with it."""
        return self.state is MemberState.READY

    def enter(self, state: MemberState, now_s: float, reason: str = "") -> None:
        """Take another state."""
        self.state, self.since_s, self.reason = state, now_s, reason

    def hear(self, health: bodies.Health, now_s: float) -> bool:
        """Take a heartbeat; return whether it is from the process we own."""
        if self.child is not None and health.pid != self.child.pid:
            return False
        self.health, self.heard_s = health, now_s
        if self.child is not None:
            self.waited = self.child.waits()
        self.window.add(health.pid, figures.contracted(health))
        return True

    def safe_stop_said(self, asked_s: float) -> float | None:
        """Return what the gateway says of its safe stop, None where it may not have heard of `asked_s` yet."""
        is_newer = self.health is not None and self.heard_s >= asked_s + _REPORT_S
        return self.health.gauges.get("safe_stop") if self.health is not None and is_newer else None

    def new_stalls(self) -> list[bodies.Stall]:
        """Return the stalls that its loop measured and that were not returned before; none of its time of starting."""
        loop = self.health.loop if self.health is not None else None
        if loop is None:
            return []
        new = [stall for stall in loop.stalls if stall.index > self._stalls_told]
        self._stalls_told = max((stall.index for stall in new), default=self._stalls_told)
        return new if self.came_up else []

    def new_detail(self, now_s: float) -> list[str]:
        """Return what it says is wrong with it, where that was not returned before.

        The same words with other numbers, of a count that goes on, are new after ten seconds only: a line each second
        would leave room for nothing else in the history.
        """
        detail = self.health.detail if self.health is not None and self.health.state == "degraded" else ""
        if not detail:
            self._detail_ended = True
            return []
        if detail == self._detail_told and not self._detail_ended:
            return []
        if now_s - self._detail_told_s < _AGAIN_S and _words(detail) == _words(self._detail_told):
            return []
        self._detail_told, self._detail_told_s, self._detail_ended = detail, now_s, False
        return [f"{self.name}: {detail}"]

    def starved(self) -> Waits:
        """Return for how long our child has waited for a processor since it was last heard, or started."""
        return self.child.waits().since(self.waited) if self.child is not None else Waits()

    def advance(self, progress: tuple[str, float], now_s: float) -> None:
        """Take what a starting process says of its progress; saying the same again is none."""
        if progress != self.progress:
            self.progress, self.advanced_s = progress, now_s
            self.waited_before_s = self.child.waits().total_s if self.child is not None else 0.0

    def forget(self) -> None:
        """Drop what the ended process said: the next one speaks for itself."""
        self.health = None
        self.stream_s = None
        self.progress = None
        self.advanced_s = self.waited_before_s = 0.0
        self.killed = False
        self.came_up = False
        self._stalls_told = 0
        self.waited = Waits()

    def kill(self) -> None:
        """End the process at once: hung processes do not answer anything gentler."""
        if self.child is not None:
            self.killed = True
            self.child.send(signal.SIGKILL)

    def body(self) -> bodies.ProcessReport:
        """Return the process as it is reported."""
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
    """Return what is said beside numbers, in any order."""
    return sorted(re.findall(r"[^\W\d]+", detail))
