"""What other processes have said last, for drivers whose device is one of them."""

from __future__ import annotations

from protocol import Frame
from services.runtime.bus import Bus


class Heard:
    """Keeps the newest frame of each topic that is asked for, so that several drivers may look at the same one."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._newest: dict[str, Frame] = {}

    def __call__(self, topic: str) -> Frame | None:
        """Return the newest frame of `topic`, which the table lets the gateway read; None before there is one."""
        frame = self._bus.latest(topic)
        if frame is not None:
            self._newest[topic] = frame
        return self._newest.get(topic)
