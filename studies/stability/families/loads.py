"""What a scene may say besides its bodies: friction of 1 to 2, and gravity in any direction."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from trocar.services.mechanics.effects.friction import FrictionSettings
from trocar.services.mechanics.effects.gravity import GravitySettings
from trocar.services.mechanics.scene import SceneModel
from trocar.studies.stability.drive import Play
from trocar.studies.stability.family import Case, Draw, played
from trocar.studies.stability.situations import approaching, beside, threaded, with_effects
from trocar.studies.stability.strokes import stroking

SITUATIONS = {"holding": threaded, "approaching": approaching, "beside": beside}
COUNT = 8
G_M_S2 = 9.81


def friction_cases(draw: Draw) -> Iterator[Case]:
    """Strokes with static coefficients of 1 to 2, kinetic ones of half of that to as much."""
    yield from _cases(draw, "friction")


def gravity_cases(draw: Draw) -> Iterator[Case]:
    """Strokes with the weight of catheter and wall in any direction."""
    yield from _cases(draw, "gravity")


def _cases(draw: Draw, what: str) -> Iterator[Case]:
    for situation in SITUATIONS if draw.is_long else ("holding",):
        for k in range(COUNT if draw.is_long else 1):
            name = f"{situation}, number {k}"
            yield played(name, partial(_play, draw, f"{what} {name}", what, situation))


def _play(draw: Draw, name: str, what: str, situation: str) -> Play:
    start, random = SITUATIONS[situation](), draw.random(name)
    scene = (_rough if what == "friction" else _tilted)(start.scene, random)
    return Play(scene=scene, hands=stroking(start, random, 300))


def _rough(scene: SceneModel, random: np.random.Generator) -> SceneModel:
    (wall, tool), (wall_part, tool_part) = random.uniform(1.0, 2.0, 2), random.uniform(0.5, 1.0, 2)
    return with_effects(scene, {"friction": FrictionSettings(wall, wall_part * wall, tool, tool_part * tool)})


def _tilted(scene: SceneModel, random: np.random.Generator) -> SceneModel:
    direction = random.normal(size=3)
    x, y, z = G_M_S2 * direction / np.linalg.norm(direction)
    return with_effects(scene, {"gravity": GravitySettings((float(x), float(y), float(z)), on_duct=True)})
