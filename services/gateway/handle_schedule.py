"""Round-robin schedule of the handles: one is served in a tick, none while haptics, on the same core, is late."""

from __future__ import annotations

#: So many ticks in a row handles wait for haptics to catch up. Where it is silent one is served in each tick.
PATIENCE = 2


class HandleSchedule:
    """The handles of `n` instruments take turns.

    A CAN exchange costs some 40 us of a core that haptics, if it is late, needs itself: of the slowest ticks of haptics
    four in five had a handle served in their midst.
    """

    def __init__(self, n: int) -> None:
        self._n = n
        self._turn = self._waited = 0

    def next(self, *, late: bool) -> int | None:
        """Return the number of the handle to serve now, None for none.

        Args:
            late: Whether the answer to this tick's sample has not come yet.
        """
        if late and self._waited < PATIENCE:
            self._waited += 1
            return None
        if not late:
            self._waited = 0
        if not self._n:
            return None
        turn, self._turn = self._turn, (self._turn + 1) % self._n
        return turn
