"""Air that was left in a catheter's lumen, which was not flushed before contrast agent came through it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class AirBubble:
    """One bubble, a ball of ``radius_m``, that leaves the tip once ``after_m3`` of contrast agent have left it."""

    radius_m: float
    after_m3: float = 0.0
