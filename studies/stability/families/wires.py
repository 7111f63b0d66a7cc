"""Guide wires: nitinol of 60 GPa and steel of 200 GPa, 0.3 to 0.9 mm thick."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from trocar.studies.stability.drive import Play
from trocar.studies.stability.family import Case, Draw, played
from trocar.studies.stability.hands import least_jerk
from trocar.studies.stability.situations import LEAD_STEPS, beside, threaded, with_catheter
from trocar.studies.stability.strokes import stroking

STIFFNESS_GPA = {60: 6450.0, 200: 7900.0}
"""By Young's modulus, the density in kg/m3: of nitinol and of stainless steel."""
SITUATIONS = {"holding": threaded, "beside": beside}
COUNT = 8


def cases(draw: Draw) -> Iterator[Case]:
    """Strokes, and in every second case a jerk."""
    for gpa in STIFFNESS_GPA if draw.is_long else (60,):
        for situation in SITUATIONS if draw.is_long else ("holding",):
            for k in range(COUNT if draw.is_long else 1):
                name = f"{gpa} GPa, {situation}, number {k}"
                yield played(name, partial(_play, draw, name, gpa, situation, jerks=k % 2 == 1))


def _play(draw: Draw, name: str, gpa: int, situation: str, *, jerks: bool) -> Play:
    start, random = SITUATIONS[situation](), draw.random(f"wires {name}")
    scene = with_catheter(
        start.scene,
        youngs_modulus_pa=1e9 * gpa,
        density_kg_m3=STIFFNESS_GPA[gpa],
        poisson_ratio=0.3,
        outer_diameter_m=random.uniform(0.3e-3, 0.9e-3),
        inner_diameter_m=0.0,
    )
    hands = stroking(start, random, 300)
    if jerks:
        direction = random.normal(size=3)
        way = least_jerk(20e-3, direction / np.linalg.norm(direction), 0.5)
        hands = hands.moved(int(random.integers(2)), way, LEAD_STEPS + 50)
    return Play(scene=scene, hands=hands)
