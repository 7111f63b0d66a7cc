"""The energy of the modelled arm."""

from __future__ import annotations

import math

from trocar.services.gateway.simulated import premium_model
from trocar.services.mechanics.arrays import FloatArray


def energy_j(angles: FloatArray, rates: FloatArray) -> float:
    """Return kinetic plus potential energy."""
    m11, m22, m23, m33 = premium_model.mass(angles)
    kinetic = m11 * rates[0] ** 2 + m22 * rates[1] ** 2 + m33 * rates[2] ** 2 + 2.0 * m23 * rates[1] * rates[2]
    return float(0.5 * kinetic + premium_model._G2 * math.sin(angles[1]) - premium_model._G3 * math.cos(angles[2]))
