"""Ways to render a wall on one axis, one a file: many hands at once, each a lane of arrays (n,).

A law is made for an arm and for walls of these stiffnesses, and is then asked once a tick for the force on the hand, N,
positive out of the wall, which is where x < 0.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from trocar.services.gateway.devices.device_files import ArmFile
from trocar.services.mechanics.arrays import FloatArray

#: An arm's own viscous friction, N s/m, as docs/results/haptics.md has it for a Premium.
VISCOUS_N_S_M = 0.05


@dataclass(frozen=True)
class Walls:
    """An arm, the stiffness of each lane's wall in N/m, (n,), and the period of the servo."""

    file: ArmFile
    stiffness_n_m: FloatArray
    period_s: float = 1e-3


class Law(Protocol):
    """A law for many lanes; it remembers what it needs."""

    def force(self, x_m: FloatArray, v_m_s: FloatArray) -> FloatArray:
        """Return the force, (n,), for where the encoders are and how fast, (n,) each."""
        ...


Make = Callable[[Walls], Law]
