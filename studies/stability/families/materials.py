"""Catheters from a thread to a wire, and masses far apart: stiffness 0.01 to 1000 times, mass 0.01 to 100 times."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from trocar.services.mechanics.effects.gallstones import GallstonesSettings
from trocar.services.mechanics.scene import SceneModel
from trocar.studies.stability.drive import Play
from trocar.studies.stability.family import Case, Draw, played
from trocar.studies.stability.hands import least_jerk
from trocar.studies.stability.situations import (
    LEAD_STEPS,
    beside,
    threaded,
    with_catheter,
    with_duct,
    with_effects,
)
from trocar.studies.stability.strokes import stroking

STIFFNESS = 0.01, 0.1, 10.0, 100.0, 1000.0
MASS = 0.01, 0.1, 10.0, 100.0
SITUATIONS = {"holding": threaded, "beside": beside}
HEAVY = ("catheter", "wall", "stone")


def stiffness_cases(draw: Draw) -> Iterator[Case]:
    """Strokes and a jerk, with every stiffness."""
    for factor in STIFFNESS if draw.is_long else (0.01, 1000.0):
        for situation in SITUATIONS if draw.is_long else ("holding",):
            for k in range(8 if draw.is_long else 1):
                name = f"{factor:g} times as stiff, {situation}, number {k}"
                yield played(name, partial(_stiff, draw, name, factor, situation, jerks=k % 2 == 1))


def mass_cases(draw: Draw) -> Iterator[Case]:
    """Strokes and a jerk, with every mass of catheter, wall, or a stone in the way."""
    for what in HEAVY if draw.is_long else ("wall",):
        for factor in MASS if draw.is_long else (100.0,):
            for k in range(5 if draw.is_long else 1):
                name = f"{what} {factor:g} times as heavy, number {k}"
                yield played(name, partial(_heavy, draw, name, what, factor, jerks=k % 2 == 1))


def _stiff(draw: Draw, name: str, factor: float, situation: str, *, jerks: bool) -> Play:
    start = SITUATIONS[situation]()
    scene = with_catheter(start.scene, youngs_modulus_pa=factor * start.scene.catheter.youngs_modulus_pa)
    return _moved(scene, situation, draw.random(f"stiffness {name}"), jerks)


def _heavy(draw: Draw, name: str, what: str, factor: float, *, jerks: bool) -> Play:
    return _moved(_weighted(threaded().scene, what, factor), "holding", draw.random(f"mass {name}"), jerks)


def _weighted(scene: SceneModel, what: str, factor: float) -> SceneModel:
    if what == "catheter":
        return with_catheter(scene, density_kg_m3=factor * scene.catheter.density_kg_m3)
    if what == "wall":
        return with_duct(scene, density_kg_m3=factor * scene.duct.density_kg_m3)
    stone = GallstonesSettings(position_m=((20e-3, 0.0, -1.5e-3),), density_kg_m3=factor * 1100.0)
    return with_effects(scene, {"gallstones": stone})


def _moved(scene: SceneModel, situation: str, random: np.random.Generator, jerks: bool) -> Play:
    start = SITUATIONS[situation]()
    hands = stroking(start, random, 300)
    if jerks:
        direction = random.normal(size=3)
        way = least_jerk(20e-3, direction / np.linalg.norm(direction), 0.5)
        hands = hands.moved(int(random.integers(2)), way, LEAD_STEPS + 50)
    return Play(scene=scene, hands=hands)
