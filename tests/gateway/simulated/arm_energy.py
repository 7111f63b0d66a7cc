"""The energy of the modelled arm."""

from __future__ import annotations

import math

from trocar.services.gateway.simulated import premium_model
from trocar.services.mechanics.arrays import FloatArray


def energy_j(angles: FloatArray, rates: FloatArray) -> float:
    """Return kinetic plus potential energy."""
    p = premium_model
    lifted_2 = 2 * p.L1 * p.MASS_A + 2 * p.L5 * p.MASS_BE + p.L1 * p.MASS_C
    lifted_3 = p.L2 * p.MASS_A + 2 * p.L3 * p.MASS_C - 2 * p.L6 * p.MASS_DF
    potential_j = 0.5 * p.GRAVITY * (lifted_2 * math.sin(angles[1]) - lifted_3 * math.cos(angles[2]))
    m11, m22, m23, m33 = p.mass(angles)
    kinetic = m11 * rates[0] ** 2 + m22 * rates[1] ** 2 + m33 * rates[2] ** 2 + 2.0 * m23 * rates[1] * rates[2]
    return float(0.5 * kinetic + potential_j)
