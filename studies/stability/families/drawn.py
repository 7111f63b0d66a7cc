"""Scenes in which everything is drawn: duct, wall, catheter, friction, effects, and two hands that cross and squeeze.

Other families vary one thing about the same scene. What nobody thought of is a combination, so here each case has its
own of everything.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.effects import EFFECTS, go_together
from trocar.services.mechanics.effects.friction import FrictionSettings
from trocar.services.mechanics.effects.gallstones import GallstonesSettings
from trocar.services.mechanics.scene import SceneModel
from trocar.studies.stability.drive import Play
from trocar.studies.stability.families.random_play import wander
from trocar.studies.stability.family import Case, Draw, played
from trocar.studies.stability.hands import HandMotions, eased, junction, still
from trocar.studies.stability.situations import LEAD_STEPS, threaded, with_catheter, with_duct

COUNT = 200
STEPS = 1_000
REACH_M = np.array([14e-3, 6e-3, 6e-3])
"""How far hands wander from where they begin: as far as they are apart, so they cross."""
LASTING_S = 0.2, 0.4
"""Of a wandering motion: hands stay below half a metre a second."""

NEED_TRAINING = {"softening"}
"""Effects for which every wall of its own takes minutes to prepare."""


def cases(draw: Draw) -> Iterator[Case]:
    """Two hundred scenes, each of its own."""
    for k in range(COUNT if draw.is_long else 2):
        yield played(f"number {k}", partial(_play, draw, k))


def _play(draw: Draw, k: int) -> Play:
    random = draw.random(f"drawn {k}")
    scene = _scene(random)
    return Play(scene=scene, hands=_hands(scene, random))


def _scene(random: np.random.Generator) -> SceneModel:
    radius_m = random.uniform(2.5e-3, 5e-3)
    catheter_m = random.uniform(0.3, 1.0) * radius_m
    around = int(random.choice([18, 24, 30]))
    scene = with_duct(
        threaded().scene,
        radius_m=radius_m,
        length_m=40e-3,
        n_around=around,
        n_along=int(around * random.uniform(1.0, 1.4)),
        taper=random.uniform(-0.2, 0.3),
        thickness_m=radius_m * np.exp(random.uniform(np.log(0.02), np.log(0.25))),
        youngs_modulus_pa=np.exp(random.uniform(np.log(20e3), np.log(1e6))),
        poisson_ratio=random.uniform(0.3, 0.48),
        damping_ratio=random.uniform(0.03, 0.3),
    )
    scene = with_catheter(
        scene,
        outer_diameter_m=catheter_m,
        inner_diameter_m=random.uniform(0.3, 0.7) * catheter_m,
        youngs_modulus_pa=np.exp(random.uniform(np.log(5e6), np.log(500e6))),
        n_segments=int(random.integers(30, 60)),
    )
    return replace(scene, effects=_effects(random, radius_m))


def _effects(random: np.random.Generator, radius_m: float) -> dict[str, object]:
    """Every effect by the toss of a coin, as far as they go together."""
    drawn: dict[str, object] = {}
    for name in random.permutation([name for name in EFFECTS if name not in NEED_TRAINING]):
        if random.random() < 0.5 and all(go_together(name, other) for other in drawn):
            drawn[str(name)] = EFFECTS[name].kind.Settings()
    if "friction" in drawn:
        static = random.uniform(0.05, 1.0)
        drawn["friction"] = FrictionSettings(static, random.uniform(0.5, 1.0) * static)
    if "gallstones" in drawn:
        drawn["gallstones"] = GallstonesSettings(((12e-3, 0.0, -0.5 * radius_m),), (0.3 * radius_m,))
    return drawn


def _hands(scene: SceneModel, random: np.random.Generator) -> HandMotions:
    """Hands that come from outside the duct, wander, roll, and open and shut their jaws."""
    left, right = scene.forceps
    above_m = scene.duct.radius_m + 6e-3
    points = (
        junction(left, (random.uniform(45e-3, 66e-3), 0.0, above_m), 10e-3),
        junction(right, (random.uniform(10e-3, 36e-3), 0.0, above_m), 10e-3),
    )
    hands = still(np.array(points), (0.7, 1.0), LEAD_STEPS + STEPS)
    for tool in (0, 1):
        hands = hands.moved(tool, _descent(above_m) + wander(random, STEPS, REACH_M, LASTING_S), LEAD_STEPS)
        opening = np.abs(wander(random, STEPS, np.array([1.0, 0.0, 0.0]), LASTING_S)[:, 0])
        hands = hands.with_jaws(tool, opening, LEAD_STEPS)
        hands = hands.rolled(tool, wander(random, STEPS, np.array([1.0, 0.0, 0.0]), LASTING_S)[:, 0], LEAD_STEPS)
    return hands


def _descent(above_m: float) -> FloatArray:
    """Offsets (STEPS, 3) down to the duct's axis within a third of the time."""
    part = np.minimum(np.arange(1, STEPS + 1) / (STEPS / 3), 1.0)
    return np.outer(eased(above_m, part), (0.0, 0.0, -1.0))
