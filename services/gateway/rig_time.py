"""The rig's time: the gateway's ticks, which go on as the clock does, slower, one by one, or not at all."""

from __future__ import annotations


class RigTime:
    """Turns ticks of the loop into those of the rig.

    At full pace they are the same, lost ones included: so the rig's time is that of the clock. Below it a tick of the
    loop in which the rig's time stands answers the tick before once more.

    Attributes:
        index: The rig's tick.
        time_ns: When it is due on the rig's grid: what simulated devices move on to.
        pace: Of the rig's time, 0 to 1.
    """

    def __init__(self, period_ns: int) -> None:
        self.index, self.time_ns = -1, 0
        self.pace = 1.0
        self._period_ns = period_ns
        self._last: int | None = None
        self._owed = 0.0

    def step(self, ticks: int) -> None:
        """Go on by so many ticks beyond what the pace gives, one in each tick of the loop."""
        self._owed += ticks

    def advance(self, loop_index: int, scheduled_ns: int) -> None:
        """Take the loop's tick of that index, which was due at `scheduled_ns`."""
        if self._last is None:
            self._last, self.time_ns = loop_index - 1, scheduled_ns - self._period_ns
        passed, self._last = loop_index - self._last, loop_index
        if self.pace == 1.0:
            self._owed, ticks = 0.0, passed
        else:
            self._owed += passed * self.pace
            ticks = 1 if self._owed >= 1.0 else 0
            self._owed -= ticks
        self.index += ticks
        self.time_ns += ticks * self._period_ns
