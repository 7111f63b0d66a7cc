"""The rig's time in gateway ticks, which follows the clock, runs slower, in single steps, or is stopped."""

from __future__ import annotations


class RigTime:
    """Converts ticks of the loop to ticks of the rig.

    At full pace they are the same, lost ones included, so the rig's time is the clock's. Below it, a tick of the loop
    in which the rig's time does not advance answers the previous tick again.

    Attributes:
        index: The rig's tick.
        time_ns: Its due time on the rig's grid, to which simulated devices advance.
        pace: Of the rig's time, 0 to 1.
        stands: Whether the tick of the loop answers the previous tick of the rig again.
    """

    def __init__(self, period_ns: int) -> None:
        self.index, self.time_ns = -1, 0
        self.pace, self.stands = 1.0, False
        self._period_ns = period_ns
        self._last: int | None = None
        self._owed = 0.0

    def step(self, ticks: int) -> None:
        """Advance by `ticks` in addition to the pace, one in each tick of the loop."""
        self._owed += ticks

    def advance(self, loop_index: int, scheduled_ns: int) -> None:
        """Process the loop's tick of that index, due at `scheduled_ns`."""
        if self._last is None:
            self._last, self.time_ns = loop_index - 1, scheduled_ns - self._period_ns
        passed, self._last = loop_index - self._last, loop_index
        if self.pace == 1.0:
            self._owed, ticks = 0.0, passed
        else:
            self._owed += passed * self.pace
            ticks = 1 if self._owed >= 1.0 else 0
            self._owed -= ticks
        self.stands = not ticks
        self.index += ticks
        self.time_ns += ticks * self._period_ns
