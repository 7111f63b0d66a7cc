"""The time-domain passivity approach: an observer of energy, and damping that takes back what the wall has given.

Hannaford and Ryu, "Time-domain passivity control of haptic interfaces", IEEE Trans. Robotics and Automation 18(1),
2002, with the observer of held forces of Ryu, Kwon and Hannaford, "Stability guaranteed control", IEEE Trans. Control
Systems Technology 12(6), 2004: the work of the force over the way that it was held for, and what the next way like
this takes.
"""

from __future__ import annotations

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.studies.feel.laws import Walls

#: The most damping that an arm bears, N s/m, by CHAI3D's `cPhantomDevice`: at a slow hand the controller would ask for
#: any, and kick.
_MOST_DAMPING = {"Touch": 4.0}
_OTHERS = 8.0


class Tdpa:
    """Impedance type, one port: the controller is a damper in series with the wall."""

    def __init__(self, walls: Walls) -> None:
        n = len(walls.stiffness_n_m)
        self._stiffness, self._most_n, self._period_s = walls.stiffness_n_m, walls.file.max_force_n, walls.period_s
        self._damping = _MOST_DAMPING.get(walls.file.model, _OTHERS)
        self._before, self._force, self._energy = np.zeros(n), np.zeros(n), np.zeros(n)

    def force(self, x_m: FloatArray, v_m_s: FloatArray) -> FloatArray:
        """Return the force, (n,)."""
        way = self._before - x_m
        self._before = x_m.copy()
        self._energy += self._force * way
        wanted = np.clip(-self._stiffness * x_m, 0.0, self._most_n)
        missing = np.minimum(0.0, self._energy + wanted * way)
        needed = np.divide(-missing, way * way, out=np.zeros_like(way), where=way != 0.0) * self._period_s
        damped = wanted + np.minimum(needed, self._damping) * way / self._period_s
        self._force = np.clip(damped, -self._most_n, self._most_n)
        return self._force.copy()
