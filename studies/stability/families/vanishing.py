"""Tools that are not there for a while: one, the other, both, for one tick or many, elsewhere when they return."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from trocar.studies.stability.drive import Play
from trocar.studies.stability.family import Case, Draw, played
from trocar.studies.stability.situations import LEAD_STEPS, beside, threaded

SITUATIONS = {"holding": threaded, "beside": beside}
STEPS = 300
COUNT = 40


def cases(draw: Draw) -> Iterator[Case]:
    """Away for 1 to 100 ticks, back where they were or up to 10 mm beside; half of them several times."""
    for situation in SITUATIONS if draw.is_long else ("holding",):
        for k in range(COUNT if draw.is_long else 1):
            name = f"{situation}, number {k}"
            yield played(name, partial(_play, draw, name, situation))


def _play(draw: Draw, name: str, situation: str) -> Play:
    start, random = SITUATIONS[situation](), draw.random(f"vanishing {name}")
    hands = start.hands.then(STEPS)
    for tool in [[0], [1], [0, 1]][random.integers(3)]:
        absent = np.zeros(len(hands), np.bool_)
        offset = np.zeros((STEPS, 3))
        for _ in range(int(random.choice([1, 5]))):
            first = int(random.integers(0, STEPS - 50))
            last = first + int(random.choice([1, 3, 20, 100]))
            absent[LEAD_STEPS + first : LEAD_STEPS + last] = True
            offset[last:] = random.choice([0.0, 1.0]) * random.uniform(-10e-3, 10e-3, 3)
        hands = hands.without(tool, absent).moved(tool, offset, LEAD_STEPS)
    return Play(scene=start.scene, hands=hands, may_jump=True)
