"""Decides how much of a core a loop reserves; pure, without kernel and clock.

A loop that uses up its reservation is not run for the rest of the period; one that reserves too much leaves no room for
others. So a loop reserves the work of most recent periods: it raises its share at once, and lowers it after a
calm time, which doubles whenever the lowered share had to be raised again.

A loop without a reservation runs only when those with one leave it time. So where there is no room for all, the most
important loops have theirs: one that is left out has those of the lowest priority reserve nothing for a while
(`pause_s`), then those above them, and at last itself. They take the next class of the ladder.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

#: Step of reservations, also the least, and the largest, as shares of a core.
STEP, MOST = 0.02, 0.9
#: Share of periods whose work is within the need, and its margin. The rest uses time that is not reserved or not used,
#: which the kernel redistributes (SCHED_FLAG_RECLAIM).
QUANTILE, MARGIN = 0.8, 1.1
#: Margin of the mean; with 1.05 a gateway ran at 919 Hz, as its ticks differ.
MEAN_MARGIN = 1.25
#: Time for which a loop may be short before others, or it, reserve nothing: first they lower what they had as a guess.
PATIENCE_S = 4.0
#: Time for which loops reserve nothing, initially and at most.
PAUSE_S, LONGEST_PAUSE_S = 10.0, 320.0
#: Calm time before the share is lowered, initially and at most.
_CALM_S, _LONGEST_CALM_S = 2.0, 320.0
_LITTLE = 1e-9

Ask = Callable[[float], bool]
"""Requests a share and returns whether the kernel admitted it; otherwise nothing has changed."""


def need_of(work_ns: NDArray[np.float64], period_ns: int) -> float:
    """Return the share of a core that a loop needs by the processor times of its periods, (periods,), at least one."""
    high_ns = float(np.sort(work_ns)[int(QUANTILE * (len(work_ns) - 1))])
    steps = max(MARGIN * high_ns, MEAN_MARGIN * float(work_ns.mean())) / period_ns / STEP
    return min(MOST, STEP * max(1, math.ceil(round(steps, 6))))


def pause_s(now_s: float, until_s: float, last_s: float) -> float:
    """Return the length of a pause that begins now, after one that lasted ``last_s`` until ``until_s``.

    It doubles as long as there was none for less time than the last one took.
    """
    return min(2.0 * last_s, LONGEST_PAUSE_S) if last_s and now_s - until_s < last_s else PAUSE_S


class Reservation:
    """The reservation of one loop.

    Attributes:
        share: Reserved share of a core; 0 while the loop has another class.
        short: The needed share, if it is larger and there is no room; else 0.
    """

    def __init__(self, share: float) -> None:
        self.share = share
        self.short = 0.0
        self._short_since_s = math.inf
        self._highest = 0.0  # largest need since the calm began
        self._calm_since_s, self._calm_s = -math.inf, _CALM_S  # the share is a guess until the first need is known
        self._lowered = False

    def follow(self, now_s: float, need: float, ask: Ask) -> None:
        """Adapt the reservation to the present need."""
        if need > self.share + _LITTLE:
            self._raise(now_s, need, ask)
        else:
            self._lower(now_s, need, ask)
        self.short = need if need > self.share + _LITTLE else 0.0
        self._short_since_s = min(self._short_since_s, now_s) if self.short else math.inf

    def is_left_out(self, now_s: float) -> bool:
        """Return whether the need has not been admitted for a while."""
        return now_s - self._short_since_s >= PATIENCE_S

    def wait_again(self, now_s: float) -> None:
        """Count the shortage from now on, as others give way."""
        self._short_since_s = now_s

    def drop(self) -> None:
        """Count as without a reservation, for a pause."""
        self.share = self.short = 0.0
        self._short_since_s = math.inf

    def _raise(self, now_s: float, need: float, ask: Ask) -> None:
        self._begin_calm(now_s, need)
        if ask(need):
            if self._lowered:
                self._lowered, self._calm_s = False, min(2.0 * self._calm_s, _LONGEST_CALM_S)
            self.share = need

    def _lower(self, now_s: float, need: float, ask: Ask) -> None:
        self._highest = max(self._highest, need)
        if now_s - self._calm_since_s >= self._calm_s:
            if self._highest < self.share - 1.5 * STEP and ask(self._highest):  # a single step is noise
                self.share, self._lowered = self._highest, math.isfinite(self._calm_since_s)
            self._begin_calm(now_s, need)

    def _begin_calm(self, now_s: float, need: float) -> None:
        self._calm_since_s, self._highest = now_s, need
