"""One attempt at a scenario: armed, running from the first motion, done or abandoned; a pure function of observations.

Its clock counts the rig's ticks, so that pause and slow motion cost the trainee no time.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from trocar.protocol.topics import TICK_S
from trocar.services.training.scenario import Goal

#: Motion of a tool that starts an attempt; a tremor, or the sag of a held arm, is smaller.
MOVED_M, OPENED_RAD = 4e-3, 0.15


class AttemptState(StrEnum):
    """States of an attempt."""

    ARMED = "armed"
    RUNNING = "running"
    DONE = "done"
    ABANDONED = "abandoned"


@dataclass(frozen=True, slots=True, kw_only=True)
class Observation:
    """Observation of the rig at one time.

    ``hands`` are (junction, 3 in m, and handle's angle in rad) of each instrument; ``fault`` is why an attempt does not
    count now, empty if it does.
    """

    tick: int
    depth_m: float = 0.0
    hands: tuple[tuple[float, float, float, float], ...] = ()
    fault: str = ""
    phase: str = ""
    errors: Mapping[str, int] = field(default_factory=dict)


class FollowedAttempt:
    """Follows one attempt through observations.

    Args:
        goal: The goal that ends it; None for practice until it is abandoned.

    Attributes:
        outcome: str. "success" or "failure" once it is done.
        reason: str. A sentence on why it ended.
        why_not: str. Why it does not count; empty if it does.
    """

    def __init__(self, goal: Goal | None) -> None:
        self.goal = goal
        self.state = AttemptState.ARMED
        self.outcome = self.reason = self.why_not = ""
        self.began_tick = -1
        self.depth_m = 0.0
        self.phase = ""
        self.errors: Mapping[str, int] = {}
        self.bookmarks_s: list[float] = []
        self._tick, self._ticks = -1, 0
        self._reached: int | None = None
        self._first: tuple[tuple[float, float, float, float], ...] = ()
        self._phases: list[str] = []

    @property
    def time_s(self) -> float:
        """Simulated time since the first motion."""
        return self._ticks * TICK_S

    @property
    def ended(self) -> bool:
        """Whether it is done or abandoned."""
        return self.state in (AttemptState.DONE, AttemptState.ABANDONED)

    def observe(self, seen: Observation) -> None:
        """Process the present observation."""
        passed, self._tick = max(seen.tick - self._tick, 0), seen.tick
        if self.ended:
            return
        self.depth_m, self.phase, self.errors = seen.depth_m, seen.phase, seen.errors
        if self.began_tick < 0 or len(seen.hands) != len(self._first):
            self.began_tick, self._first = seen.tick, seen.hands
            if seen.depth_m > 0.0:  # the earlier part was not observed
                self.spoil("the catheter was in at its beginning")
        if self.state is AttemptState.ARMED:
            if any(map(_has_moved, self._first, seen.hands)):
                self.state = AttemptState.RUNNING
            return
        self._ticks += passed
        if seen.fault:
            self.spoil(seen.fault)
        if seen.phase and seen.phase not in self._phases:
            self._phases.append(seen.phase)
        if self.goal is not None:
            self._judge(self.goal)

    def spoil(self, why: str) -> None:
        """Mark it as not counting; the first reason is kept."""
        if not self.ended and not self.why_not:
            self.why_not = why

    def bookmark(self) -> None:
        """Mark the present time."""
        self.bookmarks_s.append(round(self.time_s, 3))

    def abandon(self, reason: str) -> None:
        """Abandon it, unless it has ended."""
        if not self.ended:
            self.state, self.reason = AttemptState.ABANDONED, reason

    def _judge(self, goal: Goal) -> None:
        broken = next((code for code in goal.forbidden if self.errors.get(code)), None)
        if broken is not None:
            self._end("failure", f"{broken} must not happen")
            return
        if self.depth_m < goal.depth_m:
            self._reached = None
        else:
            self._reached = self._ticks if self._reached is None else self._reached
            if self._ticks - self._reached >= round(goal.hold_s / TICK_S):
                self._reach(goal)
                return
        if self.time_s > goal.time_limit_s:
            self._end("failure", f"the time of {goal.time_limit_s:g} s is over")

    def _reach(self, goal: Goal) -> None:
        wanted = [phase for phase in goal.phases if phase in self._phases]
        known = [phase for phase in self._phases if phase in goal.phases]
        if self._phases and (wanted != list(goal.phases) or known != wanted):
            self._end("failure", "the steps did not come in the order of the procedure")
        else:
            self._end("success", f"{1e3 * self.depth_m:.1f} mm deep after {self.time_s:.1f} s")

    def _end(self, outcome: str, reason: str) -> None:
        self.state, self.outcome, self.reason = AttemptState.DONE, outcome, reason


def _has_moved(first: tuple[float, float, float, float], now: tuple[float, float, float, float]) -> bool:
    return math.dist(first[:3], now[:3]) > MOVED_M or abs(now[3] - first[3]) > OPENED_RAD
