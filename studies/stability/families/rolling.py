"""Jaws that roll about the shaft, to and fro, with what is between them, under them, or beside them."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from trocar.studies.stability.drive import Play
from trocar.studies.stability.family import Case, Draw, played
from trocar.studies.stability.hands import least_jerk
from trocar.studies.stability.situations import LEAD_STEPS, approaching, beside, threaded
from trocar.studies.stability.strokes import repeated, stroking

SITUATIONS = {"holding": threaded, "approaching": approaching, "beside": beside}
RATES_RAD_S = 1.0, 5.0, 20.0
"""The tips of the jaws, 15 mm from J, go at up to 0.3 m/s."""
STEPS = 400
COUNT = 6


def cases(draw: Draw) -> Iterator[Case]:
    """At every rate, by turns one tool and both, in half of the cases during strokes."""
    for rate in RATES_RAD_S if draw.is_long else (5.0,):
        for situation in SITUATIONS if draw.is_long else ("holding",):
            for k in range(COUNT if draw.is_long else 1):
                name = f"{situation}, {rate:g} rad/s, number {k}"
                yield played(name, partial(_play, draw, name, situation, rate, k))


def _play(draw: Draw, name: str, situation: str, rate_rad_s: float, k: int) -> Play:
    start, random = SITUATIONS[situation](), draw.random(f"rolling {name}")
    hands = start.hands.then(STEPS) if k % 2 else stroking(start, random, STEPS)
    if situation == "beside":  # down onto the catheter and the wall
        for tool in range(2):
            hands = hands.moved(tool, least_jerk(random.uniform(8e-3, 14e-3), np.array([0.0, 0.0, -1.0]), 0.1), 20)
    for tool in ((0,), (1,), (0, 1))[k % 3]:
        turned = least_jerk(random.uniform(0.2, 1.5), random.choice([-1.0, 1.0], 1), rate_rad_s)
        there_and_back = np.concatenate([turned, turned[::-1]])
        hands = hands.rolled(tool, repeated(there_and_back, STEPS)[:, 0], LEAD_STEPS)
    return Play(scene=start.scene, hands=hands)
