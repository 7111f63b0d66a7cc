"""What every kind of output shares: whether there is a screen, and where a picture's path ends."""

from __future__ import annotations

import os
import time

from services.runtime.health import LatencyPath
from services.visualization.picture import Picture


def display_name() -> str:
    """Return the name of this host's screen, empty where it has none for us."""
    return os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY") or ""


def record(path: LatencyPath, picture: Picture) -> None:
    """Count a picture whose path ends here, unless it shows no new device sample."""
    if picture.origin_ns:
        path.asked += 1
        path.answered += 1
        path.latency.record(time.monotonic_ns() - picture.origin_ns)
