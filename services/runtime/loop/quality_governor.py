"""Decides when to lower and raise the level of a quality ladder; pure, without a clock.

It lowers the level at once and raises it slowly, by the same levels, after a calm time that doubles with each failed
try. Under constant load the times between two tries grow, so it cannot oscillate. A failed try returns to the level
from which it was made, which is known to hold.

The supervisor (the scene's ladder) and a window (its picture) use this class; the page has the same in JavaScript
(`services/visualization/web/src/view/quality_governor.js`), tested with the same table of cases. Each defines for
itself what counts as overdrawn, and which level saves enough.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum


class Load(Enum):
    """Observation: the budget is overdrawn; it is kept without room for a better level; there is room."""

    OVER = "over"
    FULL = "full"
    CALM = "calm"


@dataclass(frozen=True, slots=True)
class Hysteresis:
    """Parameters of raising the level.

    Args:
        calm_s: How long there must have been room before a better level is tried.
        trial_s: A try has failed if the budget is overdrawn within this time after it, or within the calm time before
            it; the next then waits twice as long. A successful try halves the next wait.
        longest_s: Longest wait.
    """

    calm_s: float = 20.0
    trial_s: float = 120.0
    longest_s: float = math.inf


class QualityGovernor:
    """State of a ladder: present level (0 is the best), the levels passed on the way down, and the last try.

    Args:
        n_levels: Length of the ladder.
        hysteresis: Parameters of raising the level.
        way: Levels passed so far, best first; it starts at the last and can return to the others.
    """

    def __init__(self, n_levels: int, hysteresis: Hysteresis, way: Sequence[int] = (0,)) -> None:
        self.n_levels = n_levels
        self.hysteresis = hysteresis
        self.lowered = self.raised = 0
        self._way = list(way)
        self._wait_s = hysteresis.calm_s
        self._calm_since_s: float | None = None
        self._tried_s: float | None = None
        self._came_from: int | None = None

    @property
    def level(self) -> int:
        """The present level."""
        return self._way[-1]

    @property
    def wait_s(self) -> float:
        """How long there must be room before a better level is tried."""
        return self._wait_s

    @property
    def can_lower(self) -> bool:
        """Whether there is a lower level."""
        return self.level < self.n_levels - 1

    def observe(self, now_s: float, load: Load) -> bool:
        """Process an observation at `now_s`; return whether the level has changed, by one."""
        if load is Load.OVER:
            self.overdrawn(now_s)
            return self.can_lower and self.descend()
        if load is Load.FULL:
            self.disturbed(now_s)
            return False
        return self.calm(now_s) and self.come_back(now_s)

    def disturbed(self, now_s: float) -> None:
        """Record that there is no room now, which restarts the calm time."""
        self._calm_since_s = now_s

    def is_trying(self, now_s: float) -> bool:
        """Return whether a better level was taken recently and its try is not decided."""
        return self._tried_s is not None and now_s - self._tried_s <= max(self.hysteresis.trial_s, self._wait_s)

    def overdrawn(self, now_s: float, least_wait_s: float = 0.0) -> None:
        """Record that the budget is overdrawn: a present try has failed, and the next waits at least `least_wait_s`."""
        self.disturbed(now_s)
        if self.is_trying(now_s):
            self._wait_s = min(max(2.0 * self._wait_s, least_wait_s), self.hysteresis.longest_s)
        else:
            self._came_from = None
        self._tried_s = None

    def descend(self, *path: int) -> bool:
        """Take the last level of `path`, by default the next one; after a failed try, the one from which it was made.

        The return passes all levels of the path.
        """
        self.lowered += 1
        self._way.extend([self._came_from] if self._came_from is not None else path or [self.level + 1])
        self._came_from = None
        return True

    def calm(self, now_s: float) -> bool:
        """Record that there is room now; return whether that has lasted for the wait."""
        if self._calm_since_s is None:
            self._calm_since_s = now_s
        if self._tried_s is not None and not self.is_trying(now_s):  # the try has succeeded
            self._wait_s = max(0.5 * self._wait_s, self.hysteresis.calm_s)
            self._tried_s = self._came_from = None
        return now_s - self._calm_since_s >= self._wait_s

    def come_back(self, now_s: float) -> bool:
        """Return by one level of the way; return whether there was one."""
        if len(self._way) == 1:
            return False
        self._came_from = self._way.pop()
        self.raised += 1
        self._calm_since_s = self._tried_s = now_s
        return True
