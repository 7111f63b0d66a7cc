"""The default scene: what a hand feels and the eye sees of it, beside the same with everything finer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from trocar.services.files.cache_directory import cache_directory
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.scene import SceneModel
from trocar.services.mechanics.simulation.scene_duct import build_scene_duct
from trocar.services.scenes import load_scene
from trocar.studies.accuracy import pinches
from trocar.studies.accuracy.insertions import TICK_S
from trocar.studies.accuracy.study import Choice, Draw, Error, Reference, Row, Setting, Size, Tick
from trocar.studies.accuracy.sweeps.mesh import limit_figures
from trocar.studies.accuracy.trial import Trial, percent

TITLE = "The default scene"
WHAT = (
    "The scene `default` with its own hands, as it is and with one choice coarser or finer. The reference of the pinch"
    " is the unreduced model, extrapolated from two finer meshes; that of the insertion is the same insertion with all"
    " of these choices finer at once. In `2 um wider` all vertices lie 2 um farther out: it shows how much a quantity "
    "depends on where the jaws happen to meet edges. The error of the steadying hand is in per cent of the force that "
    "presses its jaws apart, because their two pushes on the duct nearly cancel."
)
AS_IT_IS, WIDER = "as it is", "2 um wider"
INSERTING, CLOSING, STEADYING = (
    "force of the inserting hand",
    "force that closes the jaws",
    "force of the steadying hand",
)
TIP, WALL = "way of the tip", "motion of the wall"
_WIDER_M = 2e-6
Overrides = Mapping[str, Choice]


def settings(draw: Draw) -> Sequence[Setting]:
    """As it is, wider, and one choice after another coarser or finer."""
    varied: dict[str, Overrides] = {
        AS_IT_IS: {},
        WIDER: {"wider_m": _WIDER_M},
        "20 x 26 cells": {"n_around": 20, "n_along": 26},
        "40 x 40 cells": {"n_around": 40, "n_along": 40},
        "30 modes": {"n_modes": 30},
        "120 modes": {"n_modes": 120},
        "80 segments": {"n_segments": 80},
        "steps of 0.5 ms": {"dt_s": 0.5 * TICK_S},
    }
    names = draw.pick([AS_IT_IS, WIDER], [name for name in varied if "modes" not in name], list(varied))
    return [Setting(name, varied[name]) for name in names]


def reference(draw: Draw) -> Reference:
    """Return the limit of the pinch, and the insertion with everything finer."""
    around, along = draw.pick((14, 18), (84, 84), (96, 96))
    finer: Overrides = {
        "n_around": around,
        "n_along": along,
        "n_modes": draw.pick(40, 120, 160),
        "n_segments": draw.pick(50, 80, 100),
        "tolerance_n": 1e-8,
    }
    run = _trial().run(scene_of(finer, draw), draw.pick(1.0, 0.5, 0.25) * TICK_S)
    pinch_m = limit_figures(load_scene("default").duct, draw)["pinch_m"]
    return {"force_n": run.force_n, "tip_m": run.tip_m, "wall": run.wall, "pinch_m": pinch_m}


def errors(setting: Setting, reference: Reference, draw: Draw) -> dict[str, Error]:
    """Return how far off the pinch is, and what is felt and seen over the insertion, root mean square."""
    scene = scene_of(setting.choices, draw)
    duct = pinches.reduced(scene.duct)
    pinch = pinches.Pinch.of(duct.mesh, scene.duct)
    run = _trial().run(scene, float(setting.choices.get("dt_s", TICK_S)))
    felt, wanted = run.force_n, np.asarray(reference["force_n"])
    compared: dict[str, tuple[FloatArray, FloatArray]] = {
        INSERTING: (felt[:, 0, :3], wanted[:, 0, :3]),
        CLOSING: (felt[:, 1, 3:], wanted[:, 1, 3:]),
        TIP: (run.tip_m, reference["tip_m"]),
        WALL: (run.wall[:, None], reference["wall"][:, None]),
    }
    off = {name: Error(percent(found, true), "%") for name, (found, true) in compared.items()}
    pressed = np.linalg.norm(wanted[:, 1, 3:])
    apart = np.linalg.norm(felt[:, 1, :3] - wanted[:, 1, :3])
    off[STEADYING] = Error(100.0 * float(apart / pressed) if pressed else 0.0, "%")
    every = {**pinches.static_errors(duct, pinch, float(reference["pinch_m"][0]), None), **off}
    # Nobody chooses a duct that is 2 um wider: it has no place on a frontier.
    return {name: replace(each, is_known=setting.name != WIDER) for name, each in every.items()}


def tick(setting: Setting, draw: Draw) -> Tick:
    """A millisecond of the scene, most of the insertion done."""
    return _trial().tick(scene_of(setting.choices, draw), dt_s=float(setting.choices.get("dt_s", TICK_S)))


def _trial() -> Trial:
    return Trial(lambda scene: build_scene_duct(scene, cache_directory() / "bases"))


def scene_of(overrides: Overrides, draw: Draw) -> SceneModel:
    """Return the default scene with these choices."""
    scene = load_scene("default")
    duct, catheter, contact = scene.duct, scene.catheter, scene.contact
    if draw.size is Size.SMALLEST:
        duct = replace(duct, n_around=12, n_along=16, n_modes=20)
    return replace(
        scene,
        duct=replace(
            duct,
            n_around=int(overrides.get("n_around", duct.n_around)),
            n_along=int(overrides.get("n_along", duct.n_along)),
            n_modes=int(overrides.get("n_modes", duct.n_modes)),
            radius_m=duct.radius_m + float(overrides.get("wider_m", 0.0)),
        ),
        catheter=replace(catheter, n_segments=int(overrides.get("n_segments", catheter.n_segments))),
        contact=replace(contact, tolerance_n=float(overrides.get("tolerance_n", contact.tolerance_n))),
    )


def findings(rows: Sequence[Row]) -> list[str]:
    """Say what only hangs on where vertices lie."""
    both = {AS_IT_IS, WIDER} <= {row.setting for row in rows}
    return ["No finer choice removes the difference between the first two rows."] if both else []
