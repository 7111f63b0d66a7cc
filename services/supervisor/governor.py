"""The governor: which rung of the scene's quality ladder is in force. Pure decisions, without a clock.

It gives way quickly and returns slowly. Down, it takes the rung that frees most time for least error; where a loop is
as good as gone, the one that frees most time. Back it goes the way that it came, after a calm that doubles with each
return that failed: under a load that stays as it is, the times between two tries grow without bound, so it cannot
oscillate. A try that fails ends sooner than a rung that was taken for good, where it was taken from is known to hold,
and what it has lost is paid off before the next one: so much of the time lies between two tries that they never spend
more than `TRY_SHARE` of any loop's budget.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

LEAST_ERROR_PERCENT = 0.02
"""Errors below are rounding, and what frees time for less is free."""
TRY_SHARE = 0.25
"""Of the budget of the loop that loses most: more is not spent on tries that fail."""


@dataclass(frozen=True, slots=True)
class Level:
    """One rung as the scene file tells it; None where nobody has measured it.

    ``cost_us`` is that of a tick of physics; errors are against the converged reference of `trocar tune`.
    """

    name: str = "full"
    cost_us: float | None = None
    force_error_percent: float | None = None
    motion_error_percent: float | None = None

    @property
    def error_percent(self) -> float:
        """The larger error, 0 where nobody has measured."""
        return max(self.force_error_percent or 0.0, self.motion_error_percent or 0.0)

    def against(self, better: Level) -> str:
        """Return in words what this rung frees and costs, seen from another; empty where nobody has measured."""
        if self.cost_us is None or better.cost_us is None:
            return ""
        force, motion = self.force_error_percent or 0.0, self.motion_error_percent or 0.0
        return f"{better.cost_us - self.cost_us:.0f} us less a tick, force off by {force:g} %, motion by {motion:g} %"


@dataclass(frozen=True, slots=True)
class Hysteresis:
    """How slowly the governor comes back.

    ``calm_s`` is how long nothing may burn before a better rung is tried. A try has failed if a budget burns within
    ``probation_s`` after it, or within the calm that it waited for: the next waits twice as long. One that has held
    halves what the next waits for. A breakdown that stands for ``try_s`` during a try ends it: longer than a single
    stall stands.
    """

    calm_s: float = 20.0
    probation_s: float = 120.0
    try_s: float = 1.5


class Governor:
    """The ladder's memory: rung in force, the way down to it, how the last way up went."""

    def __init__(self, levels: Sequence[Level] = (Level(),), hysteresis: Hysteresis | None = None) -> None:
        self.levels = tuple(levels)
        self._hysteresis = hysteresis or Hysteresis()
        self._way = [0]
        self._wait_s = self._hysteresis.calm_s
        self._calm_since_s: float | None = None
        self._tried_s: float | None = None
        self._came_from: int | None = None
        self.lowered = self.raised = 0

    @property
    def level(self) -> int:
        """The rung in force, 0 is the best."""
        return self._way[-1]

    @property
    def rung(self) -> Level:
        """The rung in force, as the scene tells it."""
        return self.levels[self.level]

    @property
    def wait_s(self) -> float:
        """How long nothing may burn before a better rung is tried."""
        return self._wait_s

    @property
    def can_lower(self) -> bool:
        """Whether there is still something to give up."""
        return self.level < len(self.levels) - 1

    def disturbed(self) -> None:
        """Take note that something stands against a contract now: what is counted as calm begins anew."""
        self._calm_since_s = None

    def is_trying(self, now_s: float) -> bool:
        """Whether a better rung was taken so lately that it has not held yet."""
        return self._tried_s is not None and now_s - self._tried_s <= self._held_s

    def burns(self, now_s: float, spent_s: float = 0.0) -> None:
        """Take note that it has stood for too long: a try may have failed.

        ``spent_s`` is what has been lost since the last change of the rung, in seconds that the budget of the loop that
        lost most is for.
        """
        self.disturbed()
        if self.is_trying(now_s):
            self._wait_s = max(2.0 * self._wait_s, spent_s / TRY_SHARE)
        else:
            self._came_from = None
        self._tried_s = None

    def lower(self, *, by_far: bool = False) -> None:
        """Take a rung below: after a try that failed, the one that it was made from.

        Else the one that frees most time for least error, or ``by_far`` the one that frees most, from which the way
        back leads by all between; the next one where nobody has measured.
        """
        self.lowered += 1
        if self._came_from is not None:
            self._way.append(self._came_from)
        elif by_far and any(self._freed_us(k) > 0.0 for k in self._below):
            freeing = [k for k in self._below if self._freed_us(k) > 0.0]
            self._way.extend(sorted(freeing, key=self._freed_us))
        else:
            self._way.append(max(self._below, key=lambda k: (self._worth(k), -k)))
        self._came_from = None

    def calm(self, now_s: float) -> bool:
        """Take note that nothing burns now; return whether that has been so for as long as a return waits for."""
        if self._calm_since_s is None:
            self._calm_since_s = now_s
        self._hold(now_s)
        return now_s - self._calm_since_s >= self._wait_s

    def come_back(self, now_s: float) -> bool:
        """Go back by a rung, and return whether there was one to go back to."""
        if len(self._way) == 1:
            return False
        self._came_from = self._way.pop()
        self.raised += 1
        self._calm_since_s = self._tried_s = now_s
        return True

    def _hold(self, now_s: float) -> None:
        """Forgive earlier failures once a try has held."""
        if self._tried_s is not None and not self.is_trying(now_s):
            self._wait_s = max(0.5 * self._wait_s, self._hysteresis.calm_s)
            self._tried_s = self._came_from = None

    @property
    def _below(self) -> range:
        return range(self.level + 1, len(self.levels))

    @property
    def _held_s(self) -> float:
        """So long a try takes to have held."""
        return max(self._hysteresis.probation_s, self._wait_s)

    def _freed_us(self, k: int) -> float:
        """Return microseconds freed, 0 where nobody has measured."""
        here, there = self.rung, self.levels[k]
        return 0.0 if here.cost_us is None or there.cost_us is None else here.cost_us - there.cost_us

    def _worth(self, k: int) -> float:
        """Return microseconds freed for each per cent of error added."""
        added = max(self.levels[k].error_percent - self.rung.error_percent, LEAST_ERROR_PERCENT)
        return self._freed_us(k) / added
