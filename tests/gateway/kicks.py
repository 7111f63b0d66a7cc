"""What a hand would feel as a kick: a force that rises or turns. One that falls along itself lets go."""

from __future__ import annotations

import numpy as np

from services.mechanics.arrays import FloatArray


def kicks_n(forces_n: FloatArray) -> FloatArray:
    """Return how far each of forces (n, ..., 3) is from the way of the one before it to zero, (n - 1, ...)."""
    before, now = np.asarray(forces_n)[:-1], np.asarray(forces_n)[1:]
    along = (before * now).sum(axis=-1) / np.maximum((before * before).sum(axis=-1), 1e-30)
    kicks: FloatArray = np.linalg.norm(now - np.clip(along, 0.0, 1.0)[..., None] * before, axis=-1)
    return kicks
