"""Decides how much of a core a loop reserves; pure, without kernel and clock.

A loop that uses up its reservation is not run for the rest of the period; one that reserves too much leaves no room for
others. With room a loop reserves the work of nearly all recent periods: it raises its share at once, and lowers it
after a calm time, which doubles whenever the lowered share had to be raised again. Some room is left for other loops:
if the kernel would not admit a little more, every loop falls back to its mean work, and tries for more increasingly
rarely. A loop whose mean work does not fit is better off in the next class of the ladder, because exhausted budgets are
paid back over many periods, as the kernel checks them only in its own tick. It tries to return increasingly rarely.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

#: Step of reservations, also the least, and the largest, as shares of a core.
STEP, MOST = 0.02, 0.9
#: Share of periods whose work is within the need, and its margin. The rest uses time that is not reserved or not used,
#: which the kernel redistributes (SCHED_FLAG_RECLAIM). With 0.99 and 1.25 two loops left no room for a third.
QUANTILE, MARGIN = 0.95, 1.1
#: Margin of the mean when room is scarce; with 1.05 a gateway ran at 919 Hz, as its ticks differ.
LEAST_MARGIN = 1.25
#: Room is scarce if the kernel does not admit this much above a loop's share.
SPARE = 0.3
#: Calm time before the share is lowered, initially and at most.
_CALM_S, _LONGEST_S = 2.0, 320.0
#: Waits before a loop with less than its mean work retries, and before one that fell back to it tries for more.
_AGAIN_S, _TRY_S = 1.0, 10.0
#: How long a loop with less than its mean work waits for others to fall back.
_PATIENCE_S = 1.0
_LITTLE = 1e-9

Ask = Callable[[float], bool]
"""Requests a share and returns whether the kernel admitted it; otherwise nothing has changed."""


@dataclass(frozen=True, slots=True)
class Need:
    """Shares of a core: for nearly all periods, with scarce room, and of the mean work."""

    share: float
    least: float
    usual: float


def need_of(work_ns: NDArray[np.float64], period_ns: int) -> Need:
    """Return the need of a loop from the processor times `work_ns` of its periods, (periods,), at least one."""
    usual = float(work_ns.mean()) / period_ns
    high = float(np.sort(work_ns)[int(QUANTILE * (len(work_ns) - 1))]) / period_ns
    least = _up(LEAST_MARGIN * usual)
    return Need(max(least, _up(MARGIN * high)), least, usual)


def _up(share: float) -> float:
    return min(MOST, STEP * max(1, math.ceil(round(share / STEP, 6))))


class Reservation:
    """The reservation of one loop.

    Attributes:
        share: Reserved share of a core; 0 while the loop has another class.
        short: The needed share, if it is larger and there is no room; else 0.
    """

    def __init__(self, share: float) -> None:
        self.share = share
        self.short = 0.0
        self._highest = 0.0  # largest need since the calm began
        self._calm_since_s, self._calm_s = -math.inf, _CALM_S  # the share is a guess until the first need is known
        self._lowered = False
        self._starves_since_s = math.inf
        self._again_s, self._wait_s = -math.inf, _AGAIN_S
        self._refused = 0.0  # the need for which there was no room; a smaller one is requested at once
        self._try_s, self._untried_s = -math.inf, _TRY_S

    def follow(self, now_s: float, need: Need, ask: Ask) -> None:
        """Adapt the reservation to the present need."""
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
            if self._highest < self.share - 1.5 * STEP and ask(self._highest):  # a single step is noise
                self.share, self._lowered = self._highest, math.isfinite(self._calm_since_s)
            self._begin_calm(now_s, need)

    def _begin_calm(self, now_s: float, need: Need) -> None:
        self._calm_since_s, self._highest = now_s, need.share

    def gives_up(self, now_s: float, need: Need) -> bool:
        """Return whether the mean work has not fitted for a while, so that the loop must take another class."""
        if now_s - self._starves_since_s < _PATIENCE_S or not self.share:
            return False
        self.share, self._starves_since_s = 0.0, math.inf
        self._wait(now_s, need)
        return True

    def _wait(self, now_s: float, need: Need) -> None:
        self._again_s, self._wait_s = now_s + self._wait_s, min(2.0 * self._wait_s, _LONGEST_S)
        self._refused = need.least
