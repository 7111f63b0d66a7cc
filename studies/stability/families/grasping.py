"""Jaws that open and shut twenty times a second, on the catheter and on the wall, at rest and moving."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from trocar.studies.stability.drive import Play
from trocar.studies.stability.family import Case, Draw, played
from trocar.studies.stability.situations import LEAD_STEPS, threaded
from trocar.studies.stability.strokes import stroking

STEPS = 500
PERIOD_STEPS = 50
COUNT = 24


def cases(draw: Draw) -> Iterator[Case]:
    """As steps or as smooth motions; one tool by turns, or both."""
    for k in range(COUNT if draw.is_long else 1):
        name = f"number {k}"
        yield played(name, partial(_play, draw, name, k))


def _play(draw: Draw, name: str, k: int) -> Play:
    start, random = threaded(), draw.random(f"grasping {name}")
    hands = start.hands.then(STEPS) if k % 2 else stroking(start, random, STEPS)
    phase = (np.arange(STEPS) % PERIOD_STEPS) / PERIOD_STEPS
    part = (phase < 0.5).astype(np.float64) if k % 4 < 2 else 0.5 * (1.0 + np.cos(2.0 * np.pi * phase))
    for tool in ((0,), (1,), (0, 1))[k % 3]:
        shut = hands.jaw_angle_rad[-1, tool]
        hands = hands.with_jaws(tool, shut + random.uniform(0.2, 0.6) * (1.0 - part), LEAD_STEPS)
    return Play(scene=start.scene, hands=hands, may_jump=True)
