"""Two hands that come down on the duct, wander, cross, roll, and open and shut their jaws on what is there."""

from __future__ import annotations

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.scene import SceneModel
from trocar.studies.stability.hands import HandMotions, eased, junction, still, wander
from trocar.studies.stability.situations import LEAD_STEPS

STEPS = 1_000
REACH_M = np.array([14e-3, 6e-3, 6e-3])
"""How far hands wander from where they begin: as far as they are apart, so they cross."""
LASTING_S = 0.2, 0.4
"""Of a wandering motion."""
FASTEST_M_S = 0.45
"""Of a hand; motions that would be faster are made smaller."""
_UNIT = np.array([1.0, 0.0, 0.0])


def crossing_hands(
    random: np.random.Generator, scene: SceneModel, towards_m: tuple[FloatArray, FloatArray], above_m: float
) -> HandMotions:
    """Return what both hands do, drawn by `random`.

    Args:
        towards_m: Two points (3,). Each hand begins `above_m` over its own, and has come down to it after a third of
            the time.
    """
    points = [
        junction(tool, (at[0], at[1], at[2] + above_m), 10e-3)
        for tool, at in zip(scene.forceps, towards_m, strict=True)
    ]
    hands = still(np.array(points), (0.7, 1.0), LEAD_STEPS + STEPS)
    for tool in (0, 1):
        way_m = _descent(above_m) + wander(random, STEPS, REACH_M, LASTING_S)
        hands = hands.moved(tool, _at_most(way_m, FASTEST_M_S), LEAD_STEPS)
        opening = np.abs(wander(random, STEPS, _UNIT, LASTING_S)[:, 0])
        hands = hands.with_jaws(tool, opening, LEAD_STEPS)
        hands = hands.rolled(tool, wander(random, STEPS, _UNIT, LASTING_S)[:, 0], LEAD_STEPS)
    return hands


def _descent(above_m: float) -> FloatArray:
    """Offsets (STEPS, 3) down to the duct's axis within a third of the time."""
    part = np.minimum(np.arange(1, STEPS + 1) / (STEPS / 3), 1.0)
    return np.outer(eased(above_m, part), (0.0, 0.0, -1.0))


def _at_most(way_m: FloatArray, speed_m_s: float) -> FloatArray:
    """Return a way (k, 3), one row a millisecond, made smaller where it is faster than this."""
    fastest_m_s = float(np.linalg.norm(np.diff(way_m, axis=0, prepend=0.0), axis=1).max()) / 1e-3
    return way_m * min(speed_m_s / fastest_m_s, 1.0)
