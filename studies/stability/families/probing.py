"""A probe pressed into wall and catheter and dragged over both: one sphere, which must neither gain nor go through."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from trocar.services.mechanics.scene import ProbeScene
from trocar.studies.stability.drive import Play
from trocar.studies.stability.family import Case, Draw, played
from trocar.studies.stability.hands import least_jerk, still
from trocar.studies.stability.situations import LEAD_STEPS, threaded

SPEEDS_M_S = 0.05, 0.1, 0.3, 0.5
COUNT = 40
DRAGS = 4
START_HEIGHT_M = 8e-3
"""From the axis of the duct, of 4 mm, or from that of the catheter."""


def cases(draw: Draw) -> Iterator[Case]:
    """At every speed of a hand; by turns on the wall and on the catheter before the mouth."""
    for speed in SPEEDS_M_S if draw.is_long else (0.3,):
        for k in range(COUNT if draw.is_long else 2):
            name = f"{('wall', 'catheter')[k % 2]}, {speed:g} m/s, number {k}"
            yield played(name, partial(_play, draw, name, k % 2 == 0, speed))


def _play(draw: Draw, name: str, on_wall: bool, speed_m_s: float) -> Play:
    """Down by up to 2 mm of wall, or 6 mm of catheter; to and fro; and away."""
    random, start = draw.random(f"probing {name}"), threaded()
    probe = ProbeScene(port_position_m=start.scene.forceps[0].port_position_m, tip_radius_m=random.uniform(1e-3, 3e-3))
    scene = replace(start.scene, forceps=(probe,))
    x_m = random.uniform(8e-3, 34e-3) if on_wall else random.uniform(46e-3, 60e-3)
    top_m = 4.5e-3 if on_wall else 0.8e-3
    deep_m = random.uniform(0.3e-3, 2e-3) if on_wall else random.uniform(1e-3, 6e-3)
    above = np.array([[x_m, 0.0, START_HEIGHT_M], [0.0, 0.0, 0.1]])
    hands = still(above, (0.0, 0.0), LEAD_STEPS)
    ways = [least_jerk(START_HEIGHT_M - top_m - probe.tip_radius_m + deep_m, np.array([0.0, 0.0, -1.0]), speed_m_s)]
    for _ in range(DRAGS):
        direction = random.normal(size=3) * (1.0, 0.5, 0.1)
        ways.append(least_jerk(random.uniform(2e-3, 8e-3), direction / np.linalg.norm(direction), speed_m_s))
    ways.append(least_jerk(20e-3, np.array([0.0, 0.0, 1.0]), speed_m_s))
    path = np.zeros((1, 3))
    for way in ways:
        path = np.concatenate([path, path[-1] + way])
    return Play(scene=scene, hands=hands.then(len(path)).moved(0, path, LEAD_STEPS))
