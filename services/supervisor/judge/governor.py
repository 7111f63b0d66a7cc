"""The governor of the scene's quality ladder: it chooses the level; `QualityGovernor` decides when to change it.

Downwards it takes the level with the most time saved per error, or, in a breakdown of a loop, with the most time saved.
Tries of better levels are spaced so that failed ones never spend more than `TRY_SHARE` of any loop's budget.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from trocar.services.runtime.loop.quality_governor import Hysteresis, QualityGovernor

LEAST_ERROR_PERCENT = 0.02
"""Smaller errors are rounding, and count as none."""
TRY_SHARE = 0.25
"""Largest share of the budget of the worst loop spent on failed tries: three quarters are left for what is not tried.
"""


@dataclass(frozen=True, slots=True)
class Level:
    """One level of the scene file; None for values that are not measured.

    ``cost_us`` is that of a tick of physics; errors are against the converged reference of `trocar tune`.
    """

    name: str = "full"
    cost_us: float | None = None
    force_error_percent: float | None = None
    motion_error_percent: float | None = None

    @property
    def error_percent(self) -> float:
        """The larger error, 0 if not measured."""
        return max(self.force_error_percent or 0.0, self.motion_error_percent or 0.0)

    def against(self, better: Level) -> str:
        """Return a description of the time saved and the error against a better level; empty if not measured."""
        if self.cost_us is None or better.cost_us is None:
            return ""
        force, motion = self.force_error_percent or 0.0, self.motion_error_percent or 0.0
        return f"{better.cost_us - self.cost_us:.0f} us less a tick, force off by {force:g} %, motion by {motion:g} %"


class Governor(QualityGovernor):
    """A `QualityGovernor` with the measured cost and error of each level."""

    def __init__(self, levels: Sequence[Level] = (Level(),), hysteresis: Hysteresis | None = None) -> None:
        super().__init__(len(levels), hysteresis or Hysteresis())
        self.levels = tuple(levels)

    @property
    def rung(self) -> Level:
        """The present level of the scene."""
        return self.levels[self.level]

    def burns(self, now_s: float, spent_s: float = 0.0) -> None:
        """Record that a breach has stood for too long; a try may have failed.

        ``spent_s`` is the loss since the last change of level, in seconds of the budget of the worst loop.
        """
        self.overdrawn(now_s, spent_s / TRY_SHARE)

    def lower(self, *, by_far: bool = False) -> None:
        """Take the lower level with the most time saved per error, or the next one if not measured.

        With ``by_far`` it is the one with the most time saved; the return passes all levels between.
        """
        below = range(self.level + 1, self.n_levels)
        freeing = [k for k in below if self._freed_us(k) > 0.0]
        if by_far and freeing:
            self.descend(*sorted(freeing, key=self._freed_us))
        else:
            self.descend(max(below, key=lambda k: (self._worth(k), -k)))

    def _freed_us(self, k: int) -> float:
        """Return the microseconds saved by level k, 0 if not measured."""
        here, there = self.rung, self.levels[k]
        return 0.0 if here.cost_us is None or there.cost_us is None else here.cost_us - there.cost_us

    def _worth(self, k: int) -> float:
        """Return the microseconds saved per per cent of added error."""
        added = max(self.levels[k].error_percent - self.rung.error_percent, LEAST_ERROR_PERCENT)
        return self._freed_us(k) / added
