"""How much of a core a loop is to reserve, and when that is to change: pure decisions, without kernel and clock.

A loop that uses up its reservation stands still for the rest of the period, one that reserves too much leaves no room
for others. With room a loop reserves what its work took lately in nearly all periods: more at once, less after a calm,
which doubles whenever what was given back had to be asked for again. What is left over is for whoever comes: where the
kernel would not admit a little more, every loop falls back to what its work takes in the mean, and tries for more ever
more seldom. A loop whose mean work does not fit is better off in the next class of the ladder: budgets that run out are
paid back for many periods, as the kernel looks at them once in its own tick. It comes back ever more seldom to see.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

#: Reservations are multiples of this share of a core, and neither less than one nor more than the most.
STEP, MOST = 0.02, 0.9
#: Of the periods so many are within the need, before its margin. The rest is done in what nobody reserves or uses: the
#: kernel shares that out (SCHED_FLAG_RECLAIM). With 0.99 and 1.25 two loops left no room for a third.
QUANTILE, MARGIN = 0.95, 1.1
#: On top of the mean, where room is scarce: with 1.05 a gateway ran at 919 Hz, as its ticks differ.
LEAST_MARGIN = 1.25
#: Where the kernel admits no more than this above what a loop has, room is scarce.
SPARE = 0.3
#: Less is reserved after so long a calm, at first and at most.
_CALM_S, _LONGEST_S = 2.0, 320.0
#: A loop that has less than its work takes comes back after so long, one that fell back to it tries for more.
_AGAIN_S, _TRY_S = 1.0, 10.0
#: A loop with less than its mean work waits so long for others to fall back.
_PATIENCE_S = 1.0
_LITTLE = 1e-9

Ask = Callable[[float], bool]
"""Takes a share and returns whether the kernel admitted it; else nothing has changed."""


@dataclass(frozen=True, slots=True)
class Need:
    """Shares of a core: for nearly all periods; where room is scarce; what the work takes in the mean."""

    share: float
    least: float
    usual: float


def need_of(work_ns: NDArray[np.int64], period_ns: int) -> Need:
    """Return what a loop needs whose periods took `work_ns` of a core each, (periods,) and at least one."""
    usual = float(work_ns.mean()) / period_ns
    high = float(np.sort(work_ns)[int(QUANTILE * (len(work_ns) - 1))]) / period_ns
    least = _up(LEAST_MARGIN * usual)
    return Need(max(least, _up(MARGIN * high)), least, usual)


def _up(share: float) -> float:
    return min(MOST, STEP * max(1, math.ceil(round(share / STEP, 6))))


class Reservation:
    """What one loop reserves.

    Attributes:
        share: Of a core, which is reserved; 0 while the loop has another class.
        short: What it would need, where that is more and there is no room; else 0.
    """

    def __init__(self, share: float) -> None:
        self.share = share
        self.short = 0.0
        self._highest = 0.0  # need since the calm began
        self._calm_since_s, self._calm_s = -math.inf, _CALM_S  # until the first need is known the share is a guess
        self._lowered = False
        self._starves_since_s = math.inf
        self._again_s, self._wait_s = -math.inf, _AGAIN_S
        self._refused = 0.0  # the need for which there was no room: for a smaller one it is tried at once
        self._try_s, self._untried_s = -math.inf, _TRY_S

    def follow(self, now_s: float, need: Need, ask: Ask) -> None:
        """Ask for what is needed now."""
        if self.share > need.least + _LITTLE and self._is_scarce(ask):
            self._fall_back(now_s, need, ask)
        elif need.share > self.share + _LITTLE:
            self._raise(now_s, need, ask)
        else:
            self._give_back(now_s, need, ask)
        self.short = need.share if need.share > self.share + _LITTLE else 0.0
        self._starves_since_s = min(self._starves_since_s, now_s) if self.share < need.usual else math.inf

    def _is_scarce(self, ask: Ask) -> bool:
        return not (ask(self.share + SPARE) and ask(self.share))

    def _fall_back(self, now_s: float, need: Need, ask: Ask) -> None:
        if ask(need.least):
            self.share = need.least
        self._try_s, self._untried_s = now_s + self._untried_s, min(2.0 * self._untried_s, _LONGEST_S)
        self._begin_calm(now_s, need)

    def _raise(self, now_s: float, need: Need, ask: Ask) -> None:
        had = self.share
        self._begin_calm(now_s, need)
        if now_s >= self._try_s and ask(need.share + SPARE) and ask(need.share):
            self.share = need.share
        elif had < need.least - _LITTLE and (had or now_s >= self._again_s or need.least < self._refused):
            steps = range(round((need.least - had) / STEP))
            useful = (share for k in steps if (share := need.least - k * STEP) >= need.usual)
            self.share = next((share for share in useful if ask(share)), had)
            if not self.share:
                self._wait(now_s, need)
        if self._lowered and self.share > had:
            self._lowered, self._calm_s = False, min(2.0 * self._calm_s, _LONGEST_S)

    def _give_back(self, now_s: float, need: Need, ask: Ask) -> None:
        self._highest = max(self._highest, need.share)
        if now_s - self._calm_since_s >= self._calm_s:
            if self._highest < self.share - 1.5 * STEP and ask(self._highest):  # a step alone is noise
                self.share, self._lowered = self._highest, math.isfinite(self._calm_since_s)
            self._begin_calm(now_s, need)

    def _begin_calm(self, now_s: float, need: Need) -> None:
        self._calm_since_s, self._highest = now_s, need.share

    def gives_up(self, now_s: float, need: Need) -> bool:
        """Return whether the mean work has not fitted for a while: from now on the loop has another class."""
        if now_s - self._starves_since_s < _PATIENCE_S or not self.share:
            return False
        self.share, self._starves_since_s = 0.0, math.inf
        self._wait(now_s, need)
        return True

    def _wait(self, now_s: float, need: Need) -> None:
        self._again_s, self._wait_s = now_s + self._wait_s, min(2.0 * self._wait_s, _LONGEST_S)
        self._refused = need.least
