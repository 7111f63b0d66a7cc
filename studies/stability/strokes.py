"""Ordinary motions of both hands, under which something else is made hard: steps, materials, effects."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.studies.stability.hands import HandMotions, least_jerk
from trocar.studies.stability.situations import LEAD_STEPS, Situation

SPEEDS_M_S = 0.1, 0.3
ROUNDING = 1e-6
"""Of a row: times that are multiples of both steps are not quite."""


def stroking(start: Situation, random: np.random.Generator, steps: int) -> HandMotions:
    """Go on from a situation: one tool back and forth by 15 mm mostly along the duct, the other by 5 mm."""
    hands = start.hands.then(steps)
    for tool, reach_m in ((0, 15e-3), (1, 5e-3)):
        direction = random.normal(size=3) * (1.0, 0.3, 0.3)
        way = least_jerk(reach_m, direction / np.linalg.norm(direction), float(random.choice(SPEEDS_M_S)))
        hands = hands.moved(tool, repeated(np.concatenate([way, way[::-1]]), steps), LEAD_STEPS)
    return hands


def repeated(offset_m: FloatArray, steps: int) -> FloatArray:
    """The same offsets over and over, (steps, 3)."""
    return np.concatenate([offset_m] * (steps // len(offset_m) + 1))[:steps]


def at_step(hands: HandMotions, dt_s: float) -> HandMotions:
    """The same motion, given in steps of 1 ms, in steps of another length.

    Between two rows hands go straight: held at the last row they would jerk a thousand times a second, which a finer
    step resolves.
    """
    at = np.minimum(np.arange(0.0, 1e-3 * len(hands), dt_s) / 1e-3, len(hands) - 1.0)
    before: IntArray = np.floor(at + ROUNDING).astype(np.int32)
    after = np.minimum(before + 1, len(hands) - 1)
    part = np.maximum(at - before, 0.0)
    first, second = hands.sampled(before), hands.sampled(after)
    return replace(
        first,
        position_m=_between(first.position_m, second.position_m, part[:, None, None]),
        jaw_angle_rad=_between(first.jaw_angle_rad, second.jaw_angle_rad, part[:, None]),
        roll_rad=_between(first.roll_rad, second.roll_rad, part[:, None]),
    )


def _between(first: FloatArray, second: FloatArray, part: FloatArray) -> FloatArray:
    return first + part * (second - first)
