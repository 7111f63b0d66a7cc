"""What it costs to be passive with the delay and the friction of a real arm.

It is told in the error of a slow hand's force, in how stiff a wall is felt, and in the error of violent hands.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from trocar.studies.feel.compare import device_of, rendered_at
from trocar.studies.feel.hunt import AS_FILED, HUNTED_KG, MASSES_KG, Told, arm_of
from trocar.studies.feel.laws.energy_bound import EnergyBound
from trocar.studies.feel.slow_hands import HANDLE_WALLS_N_M, WALLS_N_M, feel_walls
from trocar.studies.feel.wall_hands import LAW_APART, RANGES, WALL_FORCE, books_of, decode

#: Walls whose felt stiffness is measured, N/m.
FELT_N_M = (500.0, 2000.0)
#: What servos are told: as before there were delays in their books, then more and more of what is so, then less and
#: less friction that is sure; the last is what the device files tell.
STEPS = (
    Told(0.0, 1.0),
    Told(0.1e-3, 1.0),
    Told(0.3e-3, 1.0),
    Told(1e-3, 1.0),
    Told(0.1e-3, 0.5),
    Told(0.1e-3, 0.25),
    Told(0.1e-3, 0.0),
    AS_FILED,
)


@dataclass(frozen=True)
class Cost:
    """One device whose servo is told something.

    Attributes:
        violent, slow: Mean distance from the wall's force, relative: of hands all over the hunt's cube, and of slow
            hands at three kinds of walls.
        felt_n_m: Stiffness that a hand feels of each of `FELT_N_M`; none for a handle.
    """

    device: str
    told: Told
    violent: float
    slow: tuple[float, ...]
    felt_n_m: tuple[float, ...]


def passivity_costs(hands: int, seed: int = 0) -> Iterator[Cost]:
    """Yield the cost of each of `STEPS` at each device, with so many hands of each sort."""
    shares = np.random.default_rng(seed).random((hands, len(RANGES)))
    for device in HUNTED_KG:
        walls = WALLS_N_M if device in MASSES_KG else HANDLE_WALLS_N_M
        for told in STEPS:
            books = books_of(decode(shares), arm_of(device, told=told))
            violent = float(books[:, LAW_APART].sum() / books[:, WALL_FORCE].sum())
            slow = tuple(feel_walls(device, each, hands, seed, told=told).law for each in walls)
            yield Cost(device, told, violent, slow, _felt(device, told))


def _felt(device: str, told: Told) -> tuple[float, ...]:
    if device not in MASSES_KG:
        return ()
    at = device_of(device)
    instead = {"interface_delay_s": told.delay_s, "sure_friction": told.friction}
    file = at.file.model_copy(update={key: value for key, value in instead.items() if value is not None})
    return tuple(rendered_at(EnergyBound, replace(at, file=file), each) for each in FELT_N_M)
