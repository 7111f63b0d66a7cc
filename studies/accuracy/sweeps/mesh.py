"""How fine the duct's mesh is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.fem.modes import compute_modes
from trocar.services.mechanics.scenarios import insertion_scene
from trocar.services.mechanics.scene import DuctScene, SceneModel
from trocar.services.mechanics.scene.mesh_cells import accurate_cells
from trocar.studies.accuracy import insertions, pinches
from trocar.studies.accuracy.report import costs_us, number, values
from trocar.studies.accuracy.study import Draw, Error, Reference, Row, Setting, Size, Tick

TITLE = "Mesh of the duct"
WHAT = (
    "Cells around and along the insertion's duct, with 60 modes and the residual compliance; `auto` is the mesh that "
    "`n_around: auto` chooses, as in the default scene. The reference of pinch and frequencies is the unreduced model, "
    "extrapolated from two finer meshes; that of the insertion is the finest mesh that runs in a tick."
)
_FINER = 1.5
"""Between the two meshes that lead to a limit; errors fall with the square of the cell."""
N_FREQUENCIES = 6
_N_MODES = 60


def settings(draw: Draw) -> Sequence[Setting]:
    """One series of meshes, all with about square cells, and the rule's."""
    meshes = draw.pick(
        ((12, 16), (16, 20)),
        ((12, 16), (16, 20), (20, 26), (24, 32)),
        ((12, 16), (16, 20), (20, 26), (24, 32), (28, 36), (32, 42), (40, 52)),
    )
    chosen = {f"{around} x {along} cells": (around, along) for around, along in meshes}
    if draw.size is not Size.SMALLEST:
        around, along = automatic_cells()
        chosen[f"auto, {around} x {along} cells"] = around, along
    return [Setting(name, {"duct.n_around": around, "duct.n_along": along}) for name, (around, along) in chosen.items()]


def automatic_cells() -> tuple[int, int]:
    """Return the cells that the insertion's duct has by the rule."""
    scene = insertion_scene()
    jaw_radius_m = min(tool.jaws.jaw_radius_m for tool in scene.forceps if tool.jaws)
    return accurate_cells(scene.duct.radius_m, scene.duct.length_m, jaw_radius_m)


def reference(draw: Draw) -> Reference:
    """Return the limits of pinch and frequencies, and the insertion on the finest mesh."""
    running = _duct(*draw.pick((20, 26), (84, 84), (96, 96)))
    return {**limit_figures(running, draw), **insertions.insertion_reference(_scene(running), draw)}


def limit_figures(duct: DuctScene, draw: Draw) -> dict[str, FloatArray]:
    """Return the limits of `full_figures` of a duct, whatever its own cells, that a mesh and a finer one lead to."""
    around, along = draw.pick((16, 20), (40, 52), (56, 72))
    coarse = full_figures(replace(duct, n_around=around, n_along=along))
    fine = full_figures(replace(duct, n_around=round(_FINER * around), n_along=round(_FINER * along)))
    return {name: fine[name] + (fine[name] - coarse[name]) / (_FINER**2 - 1.0) for name in fine}


def full_figures(duct: DuctScene) -> dict[str, FloatArray]:
    """Return closing under a unit pinch (1,) in m and the lowest frequencies in Hz of an unreduced duct."""
    model = pinches.full_model(duct)
    pinch = pinches.Pinch.of(model.mesh, duct)
    moved_m = model.solve_static(pinch.load_n(model.mesh.n_vertices)).displacement_m
    frequency_hz = compute_modes(model, N_FREQUENCIES).frequency_hz
    return {"pinch_m": np.array([pinch.closing_m(moved_m)]), "frequency_hz": frequency_hz}


def errors(setting: Setting, reference: Reference, draw: Draw) -> dict[str, Error]:
    """Pinch, lowest frequencies and insertion."""
    scene = _chosen(setting)
    return {**reduced_errors(scene.duct, reference), **insertions.insertion_errors(scene, reference, draw)}


def reduced_errors(scene: DuctScene, reference: Reference) -> dict[str, Error]:
    """Return the errors of a reduced duct against `full_figures`: of the pinch, and the largest of the frequencies."""
    duct = pinches.reduced(scene)
    pinch = pinches.Pinch.of(duct.mesh, scene)
    wanted_hz = reference["frequency_hz"]
    frequency_hz = duct.basis.omega_rad_s[: len(wanted_hz)] / (2.0 * np.pi)
    return {
        **pinches.static_errors(duct, pinch, float(reference["pinch_m"][0]), None),
        pinches.FREQUENCY: Error(100.0 * float(np.max(np.abs(frequency_hz / wanted_hz - 1.0))), "%"),
    }


def tick(setting: Setting, draw: Draw) -> Tick:
    """A tick of the insertion."""
    return insertions.insertion_tick(_chosen(setting), draw)


def _chosen(setting: Setting) -> SceneModel:
    return _scene(_duct(int(setting.choices["duct.n_around"]), int(setting.choices["duct.n_along"])))


def _duct(n_around: int, n_along: int) -> DuctScene:
    return replace(insertion_scene().duct, n_around=n_around, n_along=n_along, n_modes=_N_MODES)


def _scene(duct: DuctScene) -> SceneModel:
    return replace(insertion_scene(), duct=duct)


def findings(rows: Sequence[Row]) -> list[str]:
    """Say what a finer mesh buys and costs."""
    names, cost = list(dict.fromkeys(row.setting for row in rows)), costs_us(rows)
    coarse, fine = names[0], names[-1]
    error = values(rows, pinches.FORCE)
    lines = [
        f"From {coarse} to {fine} the error of the pinch falls from {number(error[coarse])} to {number(error[fine])} %."
    ]
    lines.append(
        "The force over the insertion does not converge in this scene, because its short jaws let the duct slip; the "
        "default scene's longer jaws hold it."
    )
    if coarse in cost:
        lines.append(
            f"The cost of a tick changes by {cost[fine] - cost[coarse]:+.0f} us, since smaller triangles are more "
            "candidates for contact. Nodes far from tools and catheter cost time once, when modes are computed."
        )
    return lines
