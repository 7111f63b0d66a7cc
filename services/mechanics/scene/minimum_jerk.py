"""Motion of a hand from one breakpoint to the next, for scenarios and simulated devices."""

from __future__ import annotations

import math

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import kernel


@kernel
def minimum_jerk(times: FloatArray, values: FloatArray, time: float, value: FloatArray, rate: FloatArray) -> None:
    """Write values (c,) and rates (c,) at ``time`` of breakpoints at ``times`` (k,), rows of ``values`` (k, c).

    Quintics that rest at both ends, 10 u^3 - 15 u^4 + 6 u^5 (Flash and Hogan, J. Neuroscience 5(7), 1985); constant
    before the first breakpoint and after the last. Times must increase.
    """
    last = times.shape[0] - 1
    if time < times[0] or time >= times[last]:
        end = 0 if time < times[0] else last
        for i in range(value.shape[0]):
            value[i], rate[i] = values[end, i], 0.0
        return
    k = 0
    while time >= times[k + 1]:
        k += 1
    span = times[k + 1] - times[k]
    u = (time - times[k]) / span
    s = math.pow(u, 3.0) * (10.0 + u * (6.0 * u - 15.0))
    ds = 30.0 * u * u * (1.0 - u) * (1.0 - u) / span
    for i in range(value.shape[0]):
        change = values[k + 1, i] - values[k, i]
        value[i] = values[k, i] + change * s
        rate[i] = ds * change
