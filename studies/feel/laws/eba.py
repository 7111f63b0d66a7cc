r"""The energy-bounding algorithm: force changes with way only so fast that the arm's damping takes what that makes.

Kim and Ryu, "Robustly stable haptic interaction control using an energy-bounding algorithm", IJRR 29(6), 2010. The
force that resists goes :math:`F_k = F_{k-1} + \beta_k \Delta x_k`. With a store of :math:`F^2 / 2c` the hold over a
period is passive (derived here, not taken from the paper) if

.. math:: \beta^2 \Delta x^2 / 2c + \beta F_{k-1} \Delta x / c \le F_{k-1} \Delta x + b \Delta x^2 / T,

which for :math:`c = 2b/T` says: :math:`\beta` between :math:`c` and :math:`-c - 2 F_{k-1} / \Delta x`. Where nothing
has moved the force stays.
"""

from __future__ import annotations

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.studies.feel.laws import VISCOUS_N_S_M, Walls


class Eba:
    """The viscous friction is what answers for energy: dry friction does not count."""

    def __init__(self, walls: Walls) -> None:
        self._stiffness, self._most_n = walls.stiffness_n_m, walls.file.max_force_n
        self._c = 2.0 * VISCOUS_N_S_M / walls.period_s
        self._before = np.zeros(len(walls.stiffness_n_m))
        self._force = np.zeros(len(walls.stiffness_n_m))

    def force(self, x_m: FloatArray, v_m_s: FloatArray) -> FloatArray:
        """Return the force, (n,)."""
        way = self._before - x_m  # into the wall, as the force that resists has it
        self._before = x_m.copy()
        wanted = np.clip(-self._stiffness * x_m, 0.0, self._most_n)
        moved = way != 0.0
        over = np.divide(1.0, way, out=np.zeros_like(way), where=moved)
        beta, other = (wanted - self._force) * over, -self._c - 2.0 * self._force * over
        beta = np.clip(beta, np.minimum(self._c, other), np.maximum(self._c, other))
        self._force = np.clip(np.where(moved, self._force + beta * way, self._force), -self._most_n, self._most_n)
        return self._force.copy()
