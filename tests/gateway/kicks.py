"""What a hand would feel as a kick, a force that rises or turns; and what lets a test push a hand that rests."""

from __future__ import annotations

import math

import numpy as np

from trocar.services.mechanics.arrays import FloatArray

#: Friction of an arm that takes whatever a force gives: the servo's law does not bound its energy.
ENDLESS_N = math.inf


def kicks_n(forces_n: FloatArray) -> FloatArray:
    """Return how far each of forces (n, ..., 3) is from the way of the one before it to zero, (n - 1, ...).

    One that falls along itself lets go."""
    before, now = np.asarray(forces_n)[:-1], np.asarray(forces_n)[1:]
    along = (before * now).sum(axis=-1) / np.maximum((before * before).sum(axis=-1), 1e-30)
    kicks: FloatArray = np.linalg.norm(now - np.clip(along, 0.0, 1.0)[..., None] * before, axis=-1)
    return kicks
