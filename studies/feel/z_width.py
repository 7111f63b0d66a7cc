r"""The Z-width of each arm: how stiff a wall may be beside its damping, by what the arm has and lacks.

A wall is a spring and a damper by the driver's velocity, computed in the servo and bounded by nothing. One property of
the arm at a time is made ideal, to see what it costs or gives (Colgate and Brown, IEEE ICRA 1994). Theory for one wall:
:math:`b > K T / 2 + |B|` by viscous friction (Colgate and Schenkel), :math:`K \le 2 F / q` by dry friction F and a
count q (Abbott and Okamura, IEEE Trans. Robotics 21(5), 2005).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.studies.feel.compare import TICK_S, Device, device_of, drawn_hands, stiffest_of
from trocar.studies.feel.hunt import MASSES_KG
from trocar.studies.feel.laws import Walls

#: Dampings of the wall, N s/m.
DAMPINGS_N_S_M = (0.0, 0.5, 1.0, 2.0, 5.0)
#: A count that no hand notices, m.
_FINE_M = 1e-9
CASES: dict[str, Callable[[Device], Device]] = {
    "as it is": lambda device: device,
    "exact encoder": lambda device: replace(device, file=device.file.model_copy(update={"count_m": _FINE_M})),
    "no dry friction": lambda device: replace(device, file=device.file.model_copy(update={"friction_n": 0.0})),
    "no viscous friction": lambda device: replace(device, viscous_n_s_m=0.0),
    "velocity not filtered": lambda device: replace(device, is_filtered=False),
}


@dataclass(frozen=True)
class ZWidth:
    """The stiffest passive walls of an arm, N/m, one for each of `DAMPINGS_N_S_M`, and the borders of theory."""

    arm: str
    case: str
    stiffest_n_m: tuple[float, ...]
    by_viscous_n_m: float
    by_dry_n_m: float


class Damped:
    """A spring and a damper that push only."""

    def __init__(self, walls: Walls, damping_n_s_m: float) -> None:
        self._stiffness, self._damping, self._most_n = walls.stiffness_n_m, damping_n_s_m, walls.file.max_force_n

    def force(self, x_m: FloatArray, v_m_s: FloatArray) -> FloatArray:
        """Return the force, (n,)."""
        found: FloatArray = np.where(
            x_m < 0.0, np.clip(-self._stiffness * x_m - self._damping * v_m_s, 0.0, self._most_n), 0.0
        )
        return found


def z_widths(hands: int, seed: int = 0, arms: Sequence[str] = tuple(MASSES_KG)) -> list[ZWidth]:
    """Return the Z-width of each arm, whole and with each property made ideal."""
    return [_z_width(arm, case, hands, seed) for arm in arms for case in CASES]


def _z_width(arm: str, case: str, hands: int, seed: int) -> ZWidth:
    device, drawn = CASES[case](device_of(arm)), drawn_hands(hands, seed)
    stiffest = tuple(stiffest_of(partial(Damped, damping_n_s_m=each), device, drawn) for each in DAMPINGS_N_S_M)
    dry_n_m = 2.0 * device.file.friction_n / device.file.count_m
    return ZWidth(arm, case, stiffest, 2.0 * device.viscous_n_s_m / TICK_S, dry_n_m)


def felt_shares(arm: str, stiffness_n_m: float, hertz: Sequence[float]) -> list[float]:
    """Return the stiffness that a moving hand feels at these frequencies, as shares of the wall's.

    The arm's mass m is felt with the wall: K - m (2 pi f)^2.
    """
    omega = 2.0 * np.pi * np.array(hertz)
    return [float(each) for each in 1.0 - MASSES_KG[arm] * omega**2 / stiffness_n_m]
