"""The rig's time in gateway ticks, which follows the clock, waits, runs slower, in single steps, or is stopped."""

from __future__ import annotations

#: Longest time that simulated time may be behind the clock and still catches up; what is beyond it is forgiven.
_BEHIND_NS = 50_000_000


class RigTime:
    """Converts ticks of the loop to ticks of the rig.

    At full pace they are the same, lost ones included, so the rig's time is the clock's. Below it, a tick of the loop
    in which the rig's time does not advance answers the previous tick again. Simulated time advances by single ticks,
    and only when the previous one was answered by all.

    Args:
        period_ns: Length of a tick of the rig.
        simulated: Whether the time is simulated.

    Attributes:
        index: The rig's tick.
        time_ns: Its due time on the rig's grid, to which simulated devices advance.
        pace: Of the rig's time by order, 0 to 1.
        speed: Of simulated time at full pace, 0 to 1, see `SpeedGovernor`.
        stands: Whether the tick of the loop answers the previous tick of the rig again.
    """

    def __init__(self, period_ns: int, *, simulated: bool = False) -> None:
        self.simulated = simulated
        self.index, self.time_ns = -1, 0
        self.pace, self.speed, self.stands = 1.0, 1.0, False
        self._period_ns = period_ns
        self._last: int | None = None
        self._owed = self._behind = 0.0
        self._due_ns = 0

    @property
    def is_behind(self) -> bool:
        """Whether simulated time has ticks of the clock to catch up."""
        return self._behind >= 1.0

    def step(self, ticks: int) -> None:
        """Advance by `ticks` in addition to the pace, one in each tick of the loop."""
        self._owed += ticks

    def step_soon(self) -> None:
        """Advance by a tick as soon as possible, whatever the pace."""
        self._owed = max(self._owed, 1.0)

    def advance(self, loop_index: int, scheduled_ns: int, *, is_answered: bool = True) -> None:
        """Process the loop's tick of that index, due at `scheduled_ns`.

        `is_answered` is whether all have answered the rig's present tick, for which simulated time waits.
        """
        if self._last is None:
            self._last, self.time_ns = loop_index - 1, scheduled_ns - self._period_ns
            self._due_ns = self.time_ns
        passed, self._last = loop_index - self._last, loop_index
        passed_ns, self._due_ns = scheduled_ns - self._due_ns, scheduled_ns
        if self.simulated:
            ticks = self._next_tick(passed_ns, is_answered)
        elif self.pace == 1.0:
            self._owed, ticks = 0.0, passed
        else:
            self._owed += passed * self.pace
            ticks = 1 if self._owed >= 1.0 else 0
            self._owed -= ticks
        self.stands = not ticks
        self.index += ticks
        self.time_ns += ticks * self._period_ns

    def _next_tick(self, passed_ns: int, is_answered: bool) -> int:
        """Return 1 if simulated time, `passed_ns` of the clock later, advances by a tick, else 0."""
        behind = self._behind + self.pace * self.speed * passed_ns / self._period_ns if self.pace else 0.0
        self._behind = min(behind, _BEHIND_NS / self._period_ns)
        if not is_answered or max(self._owed, self._behind) < 1.0:
            return 0
        if self._owed >= 1.0:
            self._owed -= 1.0
        else:
            self._behind -= 1.0
        return 1
