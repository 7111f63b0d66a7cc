"""How many modes, with the residual compliance and without it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from trocar.services.mechanics.scenarios import insertion_scene
from trocar.services.mechanics.scene import DuctScene, SceneModel
from trocar.studies.accuracy import insertions, pinches
from trocar.studies.accuracy.report import costs_us, number, values
from trocar.studies.accuracy.study import Draw, Error, Reference, Row, Setting, Tick

TITLE = "Modes, with the residual compliance and without"
WHAT = (
    "The number of modes of the insertion's duct, with the static response of the modes that are left out (residual) "
    "and without it (bare). The reference of pinch, wall and motion is the unreduced model of the same mesh; that of "
    "the insertion is 300 modes with the residual."
)
_STEP_S, _EVERY_S = 2.5e-4, 1e-3


def settings(draw: Draw) -> Sequence[Setting]:
    """Both series over the number of modes."""
    counts = draw.pick((10, 40), (10, 20, 40, 60, 80, 120), (5, 10, 20, 30, 40, 60, 80, 120, 160, 200))
    return [
        Setting(f"{n} modes, {word}", {"duct.n_modes": n, "duct.residual": kind}, word)
        for kind, word in (("full", "residual"), ("none", "bare"))
        for n in counts
    ]


def reference(draw: Draw) -> Reference:
    """Return the full model's pinch and motion, and the insertion on many modes."""
    duct = _duct(draw)
    model = pinches.full_model(duct)
    pinch = pinches.Pinch.of(model.mesh, duct)
    many = replace(_scene(draw), duct=replace(duct, n_modes=draw.pick(60, 300, 300)))
    return {
        "moved_m": model.solve_static(pinch.load_n(model.mesh.n_vertices)).displacement_m,
        "closing_m": pinches.full_motion_m(model, pinch, _STEP_S / 5.0, _EVERY_S),
        **insertions.insertion_reference(many, draw),
    }


def errors(setting: Setting, reference: Reference, draw: Draw) -> dict[str, Error]:
    """Pinch, wall, motion and insertion."""
    scene = _chosen(setting, draw)
    duct = pinches.reduced(scene.duct)
    pinch = pinches.Pinch.of(duct.mesh, scene.duct)
    moved_m = np.asarray(reference["moved_m"])
    motion_m = pinches.modal_motion_m(duct, pinch, _STEP_S, _EVERY_S, is_exact=False)
    return {
        **pinches.static_errors(duct, pinch, pinch.closing_m(moved_m), moved_m),
        pinches.MOTION: pinches.motion_error(motion_m, reference["closing_m"]),
        **insertions.insertion_errors(scene, reference, draw),
    }


def tick(setting: Setting, draw: Draw) -> Tick:
    """A tick of the insertion."""
    return insertions.insertion_tick(_chosen(setting, draw), draw)


def _scene(draw: Draw) -> SceneModel:
    return replace(insertion_scene(), duct=_duct(draw))


def _duct(draw: Draw) -> DuctScene:
    duct = insertion_scene().duct
    return replace(duct, n_around=draw.pick(12, duct.n_around, duct.n_around), n_along=draw.pick(16, 26, 26))


def _chosen(setting: Setting, draw: Draw) -> SceneModel:
    residual: Literal["full", "none"] = "none" if setting.choices["duct.residual"] == "none" else "full"
    n_modes = int(setting.choices["duct.n_modes"])
    return replace(_scene(draw), duct=replace(_duct(draw), n_modes=n_modes, residual=residual))


def findings(rows: Sequence[Row]) -> list[str]:
    """Say what the residual buys."""
    cost = costs_us(rows)
    few, many = _ends([row.setting for row in rows if row.series == "residual"])
    bare_few, bare_many = _ends([row.setting for row in rows if row.series == "bare"])
    error = values(rows, pinches.MOTION)
    lines = [
        f"Without the residual the motion after a push is {number(error[bare_few])} % off at {_modes(few)} and "
        f"{number(error[bare_many])} % at {_modes(many)}; with it {number(error[few])} % and {number(error[many])} %."
    ]
    if few in cost:
        lines.append(
            f"The residual costs {cost[many] - cost[bare_many]:+.0f} us a tick at the same number of modes; going from "
            f"{_modes(few)} to {_modes(many)} costs {cost[many] - cost[few]:+.0f} us. So neither is expensive: the "
            "residual makes the force right that a hand feels, more modes make the motion right."
        )
    return lines


def _modes(name: str) -> str:
    return name.partition(",")[0]


def _ends(names: Sequence[str]) -> tuple[str, str]:
    return names[0], names[-1]
