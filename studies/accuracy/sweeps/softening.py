"""How well a wall that softens has the force of the nonlinear shell, under loads that it was not trained on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from trocar.services.files.cache_directory import cache_directory
from trocar.services.mechanics.effects.base import recipe_of
from trocar.services.mechanics.effects.softening import SofteningSettings
from trocar.services.mechanics.reduction.recipe import DuctRecipe
from trocar.services.mechanics.reduction.softening.training import fetch_softening
from trocar.services.mechanics.reduction.softening.training_squeezes import Squeeze
from trocar.services.mechanics.scenarios import insertion_scene
from trocar.services.mechanics.scene import DuctScene, SceneModel
from trocar.services.mechanics.scene.duct_recipe import duct_recipe
from trocar.services.mechanics.simulation.scene_duct import build_scene_duct, scene_mesh
from trocar.studies.accuracy import insertions
from trocar.studies.accuracy.random_squeezes import Answers, answers, draw_loads, wrong_by
from trocar.studies.accuracy.report import costs_us, number, values
from trocar.studies.accuracy.study import Draw, Error, Reference, Row, Setting, Tick

TITLE = "A wall that gives way, under loads that it was not trained on"
WHAT = (
    "Random pinches of up to 60 % of the lumen's width, pokes of up to 50 % and pulls, by straight jaws of random "
    "width, a third of them on the open rim. The reference is the corotational shell on the same mesh; the error is "
    "that of the force at the same displacement of the jaws. Settings differ in the number of squeezes that softening "
    "was trained on; none is the linear wall. The cost is that of the insertion's tick."
)
MEDIAN, WORST, WAY = "force, median load", "force, worst load", "force, worst point of the way"
DAMPING_RATIO = 0.7
"""The wall comes to rest at each point; statics do not depend on it."""


def settings(draw: Draw) -> Sequence[Setting]:
    """The linear wall, and softening by the number of squeezes that it was trained on."""
    counts = draw.pick((0, 4), (0, 16, SofteningSettings().n_squeezes), (0, 8, 16, 30, 48, 80))
    return [Setting(_word(n), {"effects.softening.n_squeezes": n}, "softening") for n in counts]


def reference(draw: Draw) -> Reference:
    """Follow all loads with the nonlinear shell: forces (loads, points) in N and displacements of the jaws in m."""
    recipe = _recipe(draw)
    true = answers(recipe, _loads(draw, recipe))
    return {"force_n": true.force_n, "moved_m": true.moved_m}


def errors(setting: Setting, reference: Reference, draw: Draw) -> dict[str, Error]:
    """Squeeze the reduced wall as far, and compare the forces."""
    recipe, n_squeezes = _recipe(draw), _n_squeezes(setting)
    scene = SceneModel(duct=replace(_duct(draw), damping_ratio=DAMPING_RATIO), effects=_effects(n_squeezes))
    duct = build_scene_duct(scene, cache_directory() / "bases")
    softening = fetch_softening(recipe_of(duct, "softening"), duct, n_squeezes, duct.cache_dir) if n_squeezes else None
    true = Answers(reference["force_n"], reference["moved_m"])
    wrong = [np.abs(way) for way in wrong_by(recipe, duct, softening, _loads(draw, recipe), true)]
    last = [float(way[-1]) for way in wrong]
    return {
        MEDIAN: Error(float(np.median(last)), "%"),
        WORST: Error(max(last), "%"),
        WAY: Error(float(np.concatenate(wrong).max()), "%"),
    }


def tick(setting: Setting, draw: Draw) -> Tick:
    """A tick of the insertion with the wall that gives way, or without."""
    return insertions.insertion_tick(_scene(draw, _n_squeezes(setting)), draw)


def _loads(draw: Draw, recipe: DuctRecipe) -> list[Squeeze]:
    return draw_loads(recipe, draw.pick(3, 30, 30), draw.seed)


def _duct(draw: Draw) -> DuctScene:
    duct = insertion_scene().duct
    around, along = draw.pick((12, 16), (duct.n_around, duct.n_along), (duct.n_around, duct.n_along))
    return replace(duct, n_around=around, n_along=along, n_modes=draw.pick(20, duct.n_modes, duct.n_modes))


def _recipe(draw: Draw) -> DuctRecipe:
    duct = _duct(draw)
    return duct_recipe(duct, scene_mesh(duct))


def _scene(draw: Draw, n_squeezes: int) -> SceneModel:
    scene = replace(insertion_scene(), duct=_duct(draw))
    return replace(scene, effects={**scene.effects, **_effects(n_squeezes)})


def _effects(n_squeezes: int) -> dict[str, object]:
    return {"softening": SofteningSettings(n_squeezes)} if n_squeezes else {}


def _n_squeezes(setting: Setting) -> int:
    return int(setting.choices["effects.softening.n_squeezes"])


def _word(n_squeezes: int) -> str:
    return f"{n_squeezes} squeezes" if n_squeezes else "linear"


def findings(rows: Sequence[Row]) -> list[str]:
    """Say what softening buys."""
    median, worst, cost = values(rows, MEDIAN), values(rows, WORST), costs_us(rows)
    linear, own = _word(0), _word(SofteningSettings().n_squeezes)
    if own not in median:
        return []
    line = (
        f"The linear wall's force is {number(median[linear])} % wrong at the median and {number(worst[linear])} % at "
        f"worst; that of the default {number(median[own])} % and {number(worst[own])} %."
    )
    return [line + (f" It costs {cost[own] - cost[linear]:+.0f} us a tick." if own in cost else "")]
