"""As OpenHaptics has it: a spring and damper from proxy to device, and an arm that lets go of a hand that is too fast.

The stiffness is a share of what the device calls its most (`HD_NOMINAL_MAX_STIFFNESS`), the force at most its nominal
one; above `HD_SOFTWARE_VELOCITY_LIMIT` (1.2 m/s) an error takes the force away, here until the wall is left. A change
by more than `HD_SOFTWARE_FORCE_IMPULSE_LIMIT` (4 N in a user's code, an assumption) is an error, too. No energy is
counted.
"""

from __future__ import annotations

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.studies.feel.laws import Walls

#: Along the softest axis: the vendor's data sheets from memory, not checked against a copy.
_STIFFEST_N_M = {"Touch": 1020.0, "Touch X": 1480.0, "Phantom Premium 1.5": 3500.0}
_DAMPING_S = 1e-3
_IMPULSE_N = 4.0


class OpenHaptics:
    """Damping a thousandth of the stiffness, which only resists."""

    def __init__(self, walls: Walls) -> None:
        n = len(walls.stiffness_n_m)
        self._stiffness = np.minimum(walls.stiffness_n_m, _STIFFEST_N_M[walls.file.model])
        self._file = walls.file
        self._force, self._off = np.zeros(n), np.zeros(n, bool)

    def force(self, x_m: FloatArray, v_m_s: FloatArray) -> FloatArray:
        """Return the force, (n,)."""
        inside = x_m < 0.0
        spring = self._stiffness * (-x_m - _DAMPING_S * v_m_s)
        wanted = np.where(inside, np.clip(spring, 0.0, self._file.max_force_n), 0.0)
        failed = (np.abs(v_m_s) > self._file.max_velocity_m_s) | (np.abs(wanted - self._force) > _IMPULSE_N)
        self._off = (self._off | failed) & inside
        self._force = np.where(self._off, 0.0, wanted)
        return self._force.copy()
