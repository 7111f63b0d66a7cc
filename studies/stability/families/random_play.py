"""An hour of random play, in pieces: hands that wander, hurry, roll, grasp, let go, leave and return as they like."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from trocar.services.mechanics.arrays import BoolArray
from trocar.studies.stability.drive import Play
from trocar.studies.stability.family import Case, Draw, played
from trocar.studies.stability.hands import HandMotions, wander
from trocar.studies.stability.situations import approaching, threaded

PIECES = 240
PIECE_STEPS = 15_000
REACH_M = np.array([12e-3, 6e-3, 6e-3])
ROLL_RAD = np.array([1.0, 0.0, 0.0])


def cases(draw: Draw) -> Iterator[Case]:
    """240 pieces of a quarter of a minute."""
    for k in range(PIECES if draw.is_long else 1):
        yield played(f"piece {k}", partial(_play, draw, k, PIECE_STEPS if draw.is_long else 300))


def _play(draw: Draw, k: int, steps: int) -> Play:
    start, random = (threaded, approaching)[k % 2](), draw.random(f"random play {k}")
    hands = start.hands.then(steps)
    for tool in (0, 1):
        hands = hands.moved(tool, wander(random, steps, REACH_M), len(start.hands))
        opening = np.abs(wander(random, steps, np.array([0.5, 0.0, 0.0]))[:, 0])
        hands = hands.with_jaws(tool, hands.jaw_angle_rad[-1, tool] + opening, len(start.hands))
        hands = hands.without(tool, _absences(random, hands))
    for tool in (0, 1):
        hands = hands.rolled(tool, wander(random, steps, ROLL_RAD)[:, 0], len(start.hands))
    return Play(scene=start.scene, hands=hands, may_jump=True)


def _absences(random: np.random.Generator, hands: HandMotions) -> BoolArray:
    absent = np.zeros(len(hands), np.bool_)
    for first in random.integers(500, len(hands), len(hands) // 5000):
        absent[first : first + int(random.choice([1, 10, 500]))] = True
    return absent
