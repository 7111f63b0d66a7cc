"""What a driver knows of time."""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """What a driver knows of time; the module `time` is one."""

    def monotonic_ns(self) -> int:
        """Return the present time."""
        ...

    def sleep(self, seconds: float, /) -> None:
        """Let time pass."""
        ...


REAL_TIME: Clock = time
