"""The newest frame of each topic read by drivers, for drivers whose device is another process."""

from __future__ import annotations

from trocar.protocol import Frame
from trocar.services.runtime.bus.bus import Bus


class NewestFrames:
    """Keeps the newest frame of each topic, so that several drivers can read the same one."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._newest: dict[str, Frame] = {}

    def __call__(self, topic: str) -> Frame | None:
        """Return the newest frame of `topic`, which the gateway must be allowed to read; None before the first."""
        frame = self._bus.latest(topic)
        if frame is not None:
            self._newest[topic] = frame
        return self._newest.get(topic)
