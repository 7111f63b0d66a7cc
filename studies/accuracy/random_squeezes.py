"""Random squeezes of any duct: what the nonlinear shell answers, and how far a reduced wall is from it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.reduction import ReducedDuct
from trocar.services.mechanics.reduction.recipe import DuctRecipe
from trocar.services.mechanics.reduction.softening.load_sites import Lumen
from trocar.services.mechanics.reduction.softening.training import WallSoftening
from trocar.services.mechanics.reduction.softening.training_squeezes import (
    N_STEPS,
    Squeeze,
    draw_squeezes,
    follow,
    pressed_nodes,
)
from trocar.studies.accuracy.squeezed_wall import SqueezedWall

SEED_OF_LOADS = 1000
"""Added to a study's seed: training has a seed of its own."""
TICKS = 300


@dataclass(frozen=True, slots=True)
class Answers:
    """What the nonlinear shell answers to some loads, at points on the way of each; nan where it found none.

    Attributes:
        force_n: (loads, points) float64
        moved_m: (loads, points) float64. How far the jaws have moved.
    """

    force_n: FloatArray
    moved_m: FloatArray


def draw_loads(recipe: DuctRecipe, n: int, seed: int) -> list[Squeeze]:
    """Return random squeezes anywhere on the free wall."""
    held = np.unique(np.concatenate([support.vertices for support in recipe.supports]))
    free = np.setdiff1d(np.arange(recipe.mesh.n_vertices), held).astype(np.int32)
    return draw_squeezes(recipe, Lumen.of(recipe.mesh), free, n, SEED_OF_LOADS + seed)


def answers(recipe: DuctRecipe, loads: Sequence[Squeeze]) -> Answers:
    """Follow all loads with the nonlinear shell."""
    lumen, force, moved = Lumen.of(recipe.mesh), *np.full((2, len(loads), N_STEPS), np.nan)
    for k, load in enumerate(loads):
        _, lines = pressed_nodes(recipe, lumen, load)
        for point, state in enumerate(follow(recipe, lumen, load)[:N_STEPS]):
            force[k, point] = float(np.sum(state.force_n * lines))
            moved[k, point] = state.work_j / force[k, point]  # the jaws move all their nodes as far
    return Answers(force, moved)


def wrong_by(
    recipe: DuctRecipe,
    duct: ReducedDuct,
    softening: WallSoftening | None,
    loads: Sequence[Squeeze],
    true: Answers,
) -> list[FloatArray]:
    """Squeeze a reduced wall as far; returns for each load the force over the true one less 1, in per cent."""
    lumen, wrong = Lumen.of(recipe.mesh), []
    for load, moved_m, force_n in zip(loads, true.moved_m, true.force_n, strict=True):
        wall = SqueezedWall(duct, softening, *pressed_nodes(recipe, lumen, load))
        wrong.append(_wrong(wall, moved_m[np.isfinite(moved_m)], force_n[np.isfinite(force_n)]))
    return wrong


def _wrong(wall: SqueezedWall, moved_m: FloatArray, force_n: FloatArray) -> FloatArray:
    before, wrong = np.zeros(len(wall.nodes)), []
    for to, true in zip(moved_m, force_n, strict=True):
        wanted = np.full(len(wall.nodes), to)
        force, _ = wall.squeeze(wanted, TICKS, before)
        before = wanted
        wrong.append(100.0 * (force.sum() / true - 1.0))
    return np.array(wrong)
