"""The processor times of a run's ticks as figures: told, never judged, because they are a machine's and a day's."""

from __future__ import annotations

import numpy as np

from trocar.studies.stability.criteria import Figures

LONG_NS, LONGER_NS = 5e6, 20e6


class TickTimes:
    """Keeps the processor time of every tick."""

    def __init__(self) -> None:
        self._ns: list[int] = []

    def enter(self, ns: int) -> None:
        """Enter one tick."""
        self._ns.append(ns)

    def figures(self) -> Figures:
        """Return the median and the longest in s, and which shares took longer than 5 and 20 ms."""
        ns = np.array(self._ns or [0], np.float64)
        return {
            "tick_median": float(np.median(ns)) * 1e-9,
            "tick_longest": float(ns.max()) * 1e-9,
            "ticks_above_5_ms": float((ns > LONG_NS).mean()),
            "ticks_above_20_ms": float((ns > LONGER_NS).mean()),
        }
