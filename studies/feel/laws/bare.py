"""A spring, and nothing else: what a penalty method sends to the motors."""

from __future__ import annotations

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.studies.feel.laws import Walls


class Bare:
    """Force of the spring, up to what the motors can bear."""

    def __init__(self, walls: Walls) -> None:
        self._stiffness, self._most_n = walls.stiffness_n_m, walls.file.max_force_n

    def force(self, x_m: FloatArray, v_m_s: FloatArray) -> FloatArray:
        """Return the force, (n,)."""
        found: FloatArray = np.clip(-self._stiffness * x_m, 0.0, self._most_n)
        return found
