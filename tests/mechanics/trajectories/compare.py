"""How far two runs are apart, in quantities that do not depend on the signs of the modes."""

from __future__ import annotations

import numpy as np

from .observe import Run

PHYSICAL = ("wall_m", "catheter_m", "stone_m", "tool_force_n", "grasp_torque_nm", "proxy_m", "inserted_m")


def deviations(one: Run, other: Run) -> dict[str, float]:
    """Return how far each physical quantity is apart: of the largest difference in a tick the median over all ticks.

    Not the largest of all: a wall that slips between jaws snaps a tick earlier or later, and is millimetres off then.
    """
    apart = {}
    for name in PHYSICAL:
        if name in one.values:
            difference = np.abs(one.values[name] - other.values[name])
            apart[name] = float(np.median(difference.reshape(len(difference), -1).max(axis=1)))
    return apart


def first_difference(one: Run, other: Run) -> int | None:
    """Return the first tick in which any bit of any state or force differs, None if none does."""
    differs = np.flatnonzero(one.checksum != other.checksum)
    return int(differs[0]) if differs.size else None
