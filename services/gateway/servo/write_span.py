"""The measured time from reading a device to the return of the write that answers it."""

from __future__ import annotations

#: By how much the longest is taken to be shorter with time, s a second: 1 ms is forgotten in ten seconds.
FORGOTTEN = 1e-4


class WriteSpan:
    """Of one device.

    Attributes:
        newest_s: float. Of the newest force.
        longest_s: float. Of the longest of late, never shorter than the newest: what the next may take.
    """

    def __init__(self) -> None:
        self.newest_s = self.longest_s = 0.0

    def note(self, span_s: float, dt_s: float) -> None:
        """Note a force that took `span_s`, `dt_s` after the last."""
        self.newest_s = span_s
        self.longest_s = max(span_s, self.longest_s - FORGOTTEN * dt_s)
