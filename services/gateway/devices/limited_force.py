"""The force or torque that a device is given by another program: it rises and turns no faster than the rig's limit.

The servo's law keeps this limit, too. But a device that was not served for some ticks would get in one step what the
law has changed in all of them.
"""

from __future__ import annotations

import math

from trocar.protocol.topics import TICK_S
from trocar.services.gateway.servo.servo_law import MAX_STEP_S
from trocar.services.gateway.servo.slew import slew_vector
from trocar.services.runtime.config.rig import Vector3

#: An arm that got no force for longer may have let go, so the next begins at none.
FORGOTTEN_NS = 5_000_000
SPARE_S = 0.5 * TICK_S  # half a tick early, half a tick late: more is another tick
NO_FORCE: Vector3 = (0.0, 0.0, 0.0)
_EXACT_N = 1e-9  # far beyond the rounding of newtons, far below what a motor resolves


class LimitedForce:
    """The newest force given, and what may follow it. It falls at once, along itself.

    A tick may be early or late by some of `SPARE_S`, so time that was not used counts in the next, up to this.

    Args:
        rate_n_s: Largest rate; of a torque in N m/s, and it is then the first of the three numbers.
        forgotten_ns: Time without an order after which the device may have let go.
    """

    def __init__(self, rate_n_s: float, forgotten_ns: int = FORGOTTEN_NS) -> None:
        self.given = NO_FORCE
        self._rate_n_s, self._forgotten_ns = rate_n_s, forgotten_ns
        self._given_ns = 0
        self._credit_s = 0.0

    def next(self, wanted: Vector3, now_ns: int) -> tuple[Vector3, bool]:
        """Return the force to give now instead of `wanted`, and whether it is the wanted one."""
        passed_ns = now_ns - self._given_ns
        if self._given_ns and 0 <= passed_ns <= self._forgotten_ns:
            self._credit_s = min(self._credit_s, SPARE_S) + min(1e-9 * passed_ns, MAX_STEP_S)
        else:
            self.given, self._credit_s = NO_FORCE, TICK_S
        self._given_ns = now_ns
        fallen = self._fallen(wanted)
        self.given = slew_vector(fallen, wanted, self._rate_n_s * self._credit_s)
        self._credit_s -= math.dist(fallen, self.given) / self._rate_n_s
        return self.given, math.dist(self.given, wanted) <= _EXACT_N

    def _fallen(self, wanted: Vector3) -> Vector3:
        """Return what the last force may fall to at once on its way to the wanted one."""
        x, y, z = self.given
        square = x * x + y * y + z * z
        if square == 0.0:
            return self.given
        along = min(1.0, max(0.0, (x * wanted[0] + y * wanted[1] + z * wanted[2]) / square))
        return along * x, along * y, along * z
