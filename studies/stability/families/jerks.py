"""A hand jerks: a motion of least jerk, short and fast, in a random direction, and back or not."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from trocar.services.mechanics.effects import EFFECTS
from trocar.studies.stability.drive import Play
from trocar.studies.stability.family import Case, Draw, played
from trocar.studies.stability.hands import least_jerk
from trocar.studies.stability.situations import (
    LEAD_STEPS,
    approaching,
    beside,
    frictionless,
    threaded,
    with_effects,
)

SPEEDS_M_S = 0.1, 0.2, 0.5, 1.0, 2.0
SITUATIONS = {"holding": threaded, "approaching": approaching, "beside": beside, "frictionless": frictionless}
COUNT = 160
"""Of each speed: 40 a situation."""


def cases(draw: Draw) -> Iterator[Case]:
    """By turns of every situation, with one tool or both; the steadying one moved down first."""
    for speed in SPEEDS_M_S if draw.is_long else (0.5,):
        yield played(f"the steadying tool down by 20 mm at {speed:g} m/s", partial(_steadying, speed))
    for speed in SPEEDS_M_S if draw.is_long else (1.0,):
        for k in range(COUNT if draw.is_long else 1):
            situation = list(SITUATIONS)[k % len(SITUATIONS)]
            name = f"{situation}, {speed:g} m/s, number {k}"
            yield played(name, partial(_play, draw, name, situation, speed))


def _steadying(speed_m_s: float) -> Play:
    start = threaded()
    down = least_jerk(20e-3, np.array([0.0, 0.0, -1.0]), speed_m_s)
    return Play(scene=start.scene, hands=start.hands.then(len(down) + 100).moved(1, down, LEAD_STEPS))


def _play(draw: Draw, name: str, situation: str, speed_m_s: float) -> Play:
    start, random = SITUATIONS[situation](), draw.random(f"jerks {name}")
    scene, hands = start.scene, start.hands
    if random.random() < 0.25:
        scene = with_effects(scene, {name: EFFECTS[name].kind.Settings() for name in ("twist", "self_contact")})
    tools = [0, 1] if random.random() < 0.3 else [int(random.integers(2))]
    pause = int(random.integers(0, 100))
    for tool in tools:
        direction = random.normal(size=3)
        way = least_jerk(random.uniform(10e-3, 30e-3), direction / np.linalg.norm(direction), speed_m_s)
        if random.random() < 0.5:
            way = np.concatenate([way, np.repeat(way[-1:], pause, axis=0), way[::-1], np.zeros((1, 3))])
        hands = hands.then(max(LEAD_STEPS + len(way) + pause - len(hands), 0)).moved(tool, way, LEAD_STEPS)
    return Play(scene=scene, hands=hands, has_one_shape=situation == "frictionless")
