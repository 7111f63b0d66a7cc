"""What a wall that relaxes stores in what lags: for energy balances, too slow for a tick."""

from __future__ import annotations

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.reduction.wall_step.implicit_step import (
    WallStep,
    wall_energy,
    wall_force,
    wall_tangent_times,
)


def conjugate_energy(wall: WallStep, force: FloatArray, start: FloatArray) -> float:
    """Return the largest force . p - W(p) over modal coordinates p (r,), W the energy of the wall and its terms.

    ``force`` (r,) is what the wall would bear at that p; ``start`` (r,) is near it.
    """
    from scipy.optimize import minimize

    root = np.sqrt(wall.stiffness)

    def value(z: FloatArray) -> float:
        return 0.5 * float(z @ z) + float(wall_energy(wall.address, z / root)) - float(force @ (z / root))

    def slope(z: FloatArray) -> FloatArray:
        borne = np.zeros(len(z))
        wall_force(wall.address, z / root, borne)
        gradient: FloatArray = z - (borne + force) / root
        return gradient

    def tangent_times(z: FloatArray, v: FloatArray) -> FloatArray:
        image = np.zeros(len(z))
        wall_tangent_times(wall.address, z / root, v / root, image)
        times: FloatArray = v + image / root
        return times

    found = minimize(value, root * start, jac=slope, hessp=tangent_times, method="Newton-CG", options={"xtol": 1e-9})
    return -float(found.fun)
