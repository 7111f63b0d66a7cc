r"""The slew limiter: the written value follows the desired one at a limited rate.

With the rate limit R and a tick of :math:`\Delta t`, the written value :math:`w_k` is the point nearest to the desired
one :math:`u_k` with :math:`|w_k - w_{k-1}| \le R\,\Delta t`:

.. math:: w_k = w_{k-1} + \min\left(1, \frac{R\,\Delta t}{|u_k - w_{k-1}|}\right) (u_k - w_{k-1}).

It lies on the straight line between both, so a convex set that contains both, such as a ball of forces, contains it.
"""

from __future__ import annotations

import math

from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.vectors import Vector


@kernel
def slew(value: float, wanted: float, step: float) -> float:
    """Return ``value`` moved towards ``wanted`` by at most ``step`` >= 0, all in the same unit."""
    return min(max(wanted, value - step), value + step)


@kernel
def slew_vector(value: Vector, wanted: Vector, step: float) -> Vector:
    """Return the vector ``value`` moved straight towards ``wanted`` by at most ``step`` >= 0."""
    dx, dy, dz = wanted[0] - value[0], wanted[1] - value[1], wanted[2] - value[2]
    distance = math.sqrt(dx * dx + dy * dy + dz * dz)
    if distance <= step:
        return wanted
    share = step / distance
    return (value[0] + share * dx, value[1] + share * dy, value[2] + share * dz)
