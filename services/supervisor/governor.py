"""The governor of the scene's quality ladder: which rung to give up. When, and when to return, is `QualityGovernor`'s.

Down, it takes the rung that frees most time for least error; where a loop is as good as gone, the one that frees most
time. What a try that failed has lost is paid off before the next one: so much of the time lies between two tries that
they never spend more than `TRY_SHARE` of any loop's budget.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from services.runtime.quality_governor import Hysteresis, QualityGovernor

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


class Governor(QualityGovernor):
    """A `QualityGovernor` that knows what each rung costs and frees."""

    def __init__(self, levels: Sequence[Level] = (Level(),), hysteresis: Hysteresis | None = None) -> None:
        super().__init__(len(levels), hysteresis or Hysteresis())
        self.levels = tuple(levels)

    @property
    def rung(self) -> Level:
        """The rung in force, as the scene tells it."""
        return self.levels[self.level]

    def burns(self, now_s: float, spent_s: float = 0.0) -> None:
        """Take note that a breach has stood for too long: a try may have failed.

        ``spent_s`` is what has been lost since the last change of the rung, in seconds that the budget of the loop that
        lost most is for.
        """
        self.overdrawn(now_s, spent_s / TRY_SHARE)

    def lower(self, *, by_far: bool = False) -> None:
        """Take the rung below that frees most time for least error; the next one where nobody has measured.

        With ``by_far`` it is the one that frees most, from which the way back leads by all between.
        """
        below = range(self.level + 1, self.n_levels)
        freeing = [k for k in below if self._freed_us(k) > 0.0]
        if by_far and freeing:
            self.descend(*sorted(freeing, key=self._freed_us))
        else:
            self.descend(max(below, key=lambda k: (self._worth(k), -k)))

    def _freed_us(self, k: int) -> float:
        """Return microseconds freed, 0 where nobody has measured."""
        here, there = self.rung, self.levels[k]
        return 0.0 if here.cost_us is None or there.cost_us is None else here.cost_us - there.cost_us

    def _worth(self, k: int) -> float:
        """Return microseconds freed for each per cent of error added."""
        added = max(self.levels[k].error_percent - self.rung.error_percent, LEAST_ERROR_PERCENT)
        return self._freed_us(k) / added
