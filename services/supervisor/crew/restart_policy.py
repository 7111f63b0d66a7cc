"""How often, and how soon, a process that ends is started again."""

from __future__ import annotations

from collections import deque

MINUTE_S = 60.0  # the span for which the rig file counts restarts
#: Delay of a restart of a helper (fork server, page, school), without which a rig goes on, and most of them in a
#: minute: one that fails at its start takes a fault that lasts for ten seconds, and then no more of the processor than
#: once a minute.
HELPER_BACKOFF_S, HELPER_RETRIES = (2.0,), 5


class RestartPolicy:
    """Delays of restarts, which grow with the restarts of the last minute, and their limit.

    Args:
        backoff_s: Delay before the first, second, ... restart within a minute; the last holds for all further ones.
        max_per_minute: Restarts within a minute after which the process is given up.
    """

    def __init__(self, backoff_s: tuple[float, ...], max_per_minute: int) -> None:
        self._backoff_s = backoff_s or (0.0,)
        self._max = max_per_minute
        self._times_s: deque[float] = deque()
        self.count = 0

    def delay_s(self, now_s: float) -> float | None:
        """Count a restart at `now_s` and return its delay; None at the limit."""
        while self._times_s and now_s - self._times_s[0] > MINUTE_S:
            self._times_s.popleft()
        if len(self._times_s) >= self._max:
            return None
        delay = self._backoff_s[min(len(self._times_s), len(self._backoff_s) - 1)]
        self._times_s.append(now_s)
        self.count += 1
        return delay

    def forgive(self) -> None:
        """Reset the count, as a person has armed the rig."""
        self._times_s.clear()


def helper_restarts() -> RestartPolicy:
    """Return the policy for a helper of the supervisor."""
    return RestartPolicy(HELPER_BACKOFF_S, HELPER_RETRIES)
