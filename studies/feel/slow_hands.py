"""What the bound by energy costs hands that mean no harm: how far the felt force is from the wall's own.

Hands press with 0.1 to 2 N at 5 to 50 mm/s, damped so that their own grip does not throw them, and draw back as slowly.
They are told fresh models, 1 to 4 ms old, whose stiffness is within 25 % of the wall's. Forces come as late as the
servo is told that they may, and the arm has the vendor's friction.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.studies.feel.hunt import AS_FILED, Told, arm_of
from trocar.studies.feel.wall_hands import (
    ALONG,
    DAMPING,
    DEPTH,
    DRAW,
    FRICTION,
    GRIP,
    HAND,
    HAND_LOSS,
    LATE,
    LAW_APART,
    MASS,
    MODEL,
    MODEL_APART,
    OUT,
    PLACE,
    PRESS,
    RANGES,
    REST,
    SOFT,
    STAY,
    TANGENTIAL,
    WALL,
    WALL_FORCE,
    WRITE,
    books_of,
)

WALLS_N_M = ((50.0, 600.0), (600.0, 1300.0), (1300.0, 2500.0))
#: Those of a handle, at its lever: jaws on tissue are softer.
HANDLE_WALLS_N_M = ((20.0, 60.0), (60.0, 200.0), (200.0, 600.0))
#: Local stiffnesses of models, as multiples of the wall's.
TOLD = (0.5, 0.8, 1.0, 1.25, 2.0)


@dataclass(frozen=True)
class Slow:
    """Mean distance from the wall's force, relative, over hands: of the law, and of the local model alone."""

    arm: str
    walls_n_m: tuple[float, float]
    law: float
    model: float


def feel_walls(
    name: str,
    walls_n_m: tuple[float, float],
    count: int,
    seed: int = 0,
    local: float | None = None,
    told: Told = AS_FILED,
) -> Slow:
    """Return how far from walls of these stiffnesses ``count`` slow hands feel them at one arm.

    ``local`` is the local stiffness of every model, as a multiple of the wall's.
    """
    arm = arm_of(name, told=told)
    hands = slow_hands(arm.mass_kg, walls_n_m, count, seed)
    if local is not None:
        hands[:, MODEL] = local
    books = books_of(hands, arm)
    books = books[books[:, WALL_FORCE] > 0.0]
    law, model = (books[:, which] / books[:, WALL_FORCE] for which in (LAW_APART, MODEL_APART))
    return Slow(name, walls_n_m, float(law.mean()), float(model.mean()))


def slow_hands(mass_kg: float, walls_n_m: tuple[float, float], count: int, seed: int) -> FloatArray:
    """Return hands (count, len(RANGES)) in the units of `RANGES`."""
    random, hands = np.random.default_rng(seed), np.zeros((count, len(RANGES)))

    def decades(low: float, high: float) -> FloatArray:
        return np.exp(random.uniform(np.log(low), np.log(high), count))

    hands[:, WALL], hands[:, HAND] = decades(*walls_n_m), decades(100.0, 2000.0)
    hands[:, HAND_LOSS] = 2.0 * np.sqrt(mass_kg * hands[:, HAND])
    hands[:, TANGENTIAL], hands[:, PLACE] = random.random(count), random.random(count)
    hands[:, MODEL], hands[:, DAMPING] = decades(0.8, 1.25), decades(1e-3, 1.0)
    hands[:, LATE], hands[:, SOFT] = random.uniform(1.0, 4.0, count), 1.0
    hands[:, DEPTH] = np.minimum(decades(0.1, 2.0) * (1.0 / hands[:, WALL] + 1.0 / hands[:, HAND]), 10e-3)
    hands[:, PRESS], hands[:, DRAW] = decades(5e-3, 50e-3), decades(5e-3, 50e-3)
    hands[:, REST], hands[:, OUT] = decades(0.01, 0.1), random.uniform(-2e-3, 5e-3, count)
    hands[:, ALONG], hands[:, STAY] = random.uniform(-1.0, 1.0, count), 1.2
    hands[:, WRITE], hands[:, FRICTION], hands[:, MASS], hands[:, GRIP] = 1.0, 1.0, 1.0, 15.0
    return hands
