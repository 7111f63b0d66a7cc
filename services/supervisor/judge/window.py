"""Counts over the last seconds, and since a time, from reports with counts since a process began."""

from __future__ import annotations

import math
from collections import deque
from itertools import chain, islice

from trocar.services.supervisor.judge.figures import Figures, Loop, Path

#: How long all reports are kept, and the spacing of those kept after that: the last five seconds, of which contracts
#: are judged (`contracts.STILL_S`), begin at a report of their own; a minute is exact to a sixtieth
#: of it, by a step of a second.
_FINE_S, _COARSE_STEP_S = 6.0, 1.0
#: Tolerance of the spacing, as reports are only about a tenth of a second apart.
_SLACK_S = 0.02


def _rate(figures: Figures) -> float | None:
    return None if figures.loop is None else figures.loop.target_hz


class Window:
    """The counts of one process over the last `seconds_max`, cleared when it restarts or changes its rate.

    All reports of the last seconds are kept, and older ones a second apart: figures over a minute need no more, and
    every report contains about ten histograms.
    """

    def __init__(self, seconds_max: float) -> None:
        self._seconds_max = seconds_max
        self._pid = 0
        self._coarse: deque[Figures] = deque()
        self._fine: deque[Figures] = deque()

    def add(self, pid: int, figures: Figures) -> None:
        """Add the cumulative `figures` of a report; one at a time that is no number would never leave the window."""
        if not math.isfinite(figures.seconds):
            return
        last = self._fine[-1] if self._fine else None
        if last is None or pid != self._pid or figures.seconds < last.seconds or _rate(figures) != _rate(last):
            self._fine.clear()
            self._coarse.clear()
        self._pid = pid
        self._fine.append(figures)
        self._thin(figures.seconds)

    def _thin(self, now_s: float) -> None:
        while len(self._fine) > 2 and now_s - self._fine[1].seconds >= _FINE_S:
            old = self._fine.popleft()
            if not self._coarse or old.seconds - self._coarse[-1].seconds >= _COARSE_STEP_S:
                self._coarse.append(old)
        while len(self._coarse) > 1 and now_s - self._coarse[1].seconds >= self._seconds_max:
            self._coarse.popleft()

    def __len__(self) -> int:
        """Return the number of stored reports."""
        return len(self._coarse) + len(self._fine)

    def forget_reports(self) -> None:
        """Discard all but the newest report."""
        self._coarse.clear()
        while len(self._fine) > 1:
            self._fine.popleft()

    def figures(self, seconds: float) -> Figures | None:
        """Return the counts of about the last `seconds`, or of a shorter known time; None before the second report."""
        ends = self._ends(seconds)
        return None if ends is None else ends[0] - ends[1]

    def loop(self, seconds: float) -> tuple[Loop, float] | None:
        """Return the loop's part of `figures` and its duration; None also without a loop."""
        ends = self._ends(seconds)
        loop = None if ends is None else ends[0].loop
        if ends is None or loop is None:
            return None
        before = ends[1].loop
        return loop - before if before else loop, ends[0].seconds - ends[1].seconds

    def path(self, name: str, seconds: float) -> Path | None:
        """Return one path's part of `figures`; None also without such a path."""
        ends = self._ends(seconds)
        if ends is None or name not in ends[0].paths:
            return None
        newest, oldest = ends[0].paths[name], ends[1].paths.get(name)
        return newest if oldest is None else newest - oldest

    def _ends(self, seconds: float) -> tuple[Figures, Figures] | None:
        """Return the newest report and the one of `seconds` before it, or the oldest."""
        if len(self._fine) < 2:
            return None
        newest, enough_s = self._fine[-1], seconds - _SLACK_S
        oldest = self._coarse[0] if self._coarse else self._fine[0]
        for report in chain(islice(reversed(self._fine), 1, None), reversed(self._coarse)):
            if newest.seconds - report.seconds >= enough_s:
                return newest, report
        return newest, oldest
