"""Round-robin schedule of the handles: at most one per tick, and none while haptics, on the same core, is late."""

from __future__ import annotations

#: Most ticks in a row that handles wait for haptics. If it is silent, one handle is served in each tick.
PATIENCE = 2


class HandleSchedule:
    """The handles of `n` instruments take turns.

    A CAN exchange costs about 40 us on the core that a late haptics needs: without this, four in five of the slowest
    ticks of haptics were interrupted by one.
    """

    def __init__(self, n: int) -> None:
        self._n = n
        self._turn = self._waited = 0

    def next(self, *, late: bool) -> int | None:
        """Return the index of the handle to serve now, None for none.

        Args:
            late: Whether the answer to this tick's sample has not arrived yet.
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
