"""Events about stalls that a loop has measured: at most one a second, since a busy host may stall it at every tick."""

from __future__ import annotations

from collections.abc import Iterable

import trocar.protocol.bodies as bodies

#: A line of a second tells all its stalls; more lines would fill the page, as a busy host stalls a loop many times a
#: second.
_SAY_EVERY_S = 1.0


class StallMessages:
    """The stalls of one loop since its start that were not told yet."""

    def __init__(self) -> None:
        self._index = 0
        self._untold_ms: list[float] = []
        self._said_s = float("-inf")

    def hear_stalls(self, stalls: Iterable[bodies.Stall], *, starts: bool) -> None:
        """Take the stalls of a report; those of a loop that ``starts`` are not told."""
        new = [stall for stall in stalls if stall.index > self._index]
        self._index = max((stall.index for stall in new), default=self._index)
        if not starts:
            self._untold_ms += [stall.length_ns * 1e-6 for stall in new]

    def due_message(self, now_s: float) -> str:
        """Return the lengths of the stalls that are due, empty if there are none."""
        if not self._untold_ms or now_s - self._said_s < _SAY_EVERY_S:
            return ""
        self._said_s, lengths_ms, self._untold_ms = now_s, self._untold_ms, []
        return f"stalled for {', '.join(f'{length_ms:.0f}' for length_ms in lengths_ms)} ms"
