"""Interface of the clock that drivers use."""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """A clock for drivers; the module `time` is one."""

    def monotonic_ns(self) -> int:
        """Return the present time."""
        ...

    def sleep(self, seconds: float, /) -> None:
        """Sleep."""
        ...


REAL_TIME: Clock = time
