"""Common functions of outputs: the name of the screen, and counting a picture's latency."""

from __future__ import annotations

import os
import time

from trocar.services.runtime.process.health import LatencyPath
from trocar.services.visualization.picture import Picture


def display_name() -> str:
    """Return the name of this host's screen, empty without one."""
    return os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY") or ""


def record(path: LatencyPath, picture: Picture) -> None:
    """Count the latency of a picture at the end of its path, if it shows a new device sample."""
    if picture.origin_ns:
        path.asked += 1
        path.answered += 1
        path.latency.record(time.monotonic_ns() - picture.origin_ns)
