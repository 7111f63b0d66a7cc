"""Which membrane and which bending triangle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import cast

from trocar.services.mechanics.fem.elements import BENDING_ELEMENTS, MEMBRANE_ELEMENTS, BendingChoice, MembraneName
from trocar.services.mechanics.scenarios import insertion_scene
from trocar.services.mechanics.scene import DuctScene, SceneModel
from trocar.studies.accuracy import insertions, pinches
from trocar.studies.accuracy.study import Draw, Error, Reference, Row, Setting, Tick
from trocar.studies.accuracy.sweeps.mesh import limit_figures, reduced_errors

TITLE = "Triangles of the wall"
WHAT = (
    "Every membrane with every bending triangle, on two meshes, with 60 modes and the residual compliance. The "
    "reference is extrapolated from two finer meshes of the default triangles. Triangles affect the cost of the modes,"
    " which are computed once, and not that of a tick. Those kept for comparison only cannot be on the frontier."
)
_N_MODES = 60


def settings(draw: Draw) -> Sequence[Setting]:
    """A series a pair of triangles, over meshes."""
    meshes = draw.pick(((12, 16),), ((12, 16), (20, 26)), ((12, 16), (20, 26), (32, 42)))
    return [
        Setting(
            f"{membrane}, {bending}, {around} x {along}",
            {"duct.membrane": membrane, "duct.bending": bending, "duct.n_around": around, "duct.n_along": along},
            f"{membrane}, {bending}",
        )
        for membrane in MEMBRANE_ELEMENTS
        for bending in BENDING_ELEMENTS
        for around, along in meshes
    ]


def reference(draw: Draw) -> Reference:
    """Return the limits of pinch and frequencies."""
    return limit_figures(insertion_scene().duct, draw)


def errors(setting: Setting, reference: Reference, draw: Draw) -> dict[str, Error]:
    """Pinch and lowest frequencies; triangles that are for comparison only may be right by accident."""
    duct = _chosen(setting).duct
    is_choice = not (
        MEMBRANE_ELEMENTS[duct.membrane].is_reference_only or BENDING_ELEMENTS[duct.bending].is_reference_only
    )
    every = reduced_errors(duct, reference)
    return {name: replace(each, is_known=is_choice) for name, each in every.items()}


def tick(setting: Setting, draw: Draw) -> Tick:
    """A tick of the insertion."""
    return insertions.insertion_tick(_chosen(setting), draw)


def _chosen(setting: Setting) -> SceneModel:
    choices = setting.choices
    duct: DuctScene = replace(
        insertion_scene().duct,
        membrane=cast(MembraneName, choices["duct.membrane"]),
        bending=cast(BendingChoice, choices["duct.bending"]),
        n_around=int(choices["duct.n_around"]),
        n_along=int(choices["duct.n_along"]),
        n_modes=_N_MODES,
    )
    return replace(insertion_scene(), duct=duct)


def findings(rows: Sequence[Row]) -> list[str]:
    """Say which triangles get worse on a finer mesh."""
    away = [series for series in dict.fromkeys(row.series for row in rows) if _moves_away(rows, series)]
    if not away:
        return []
    return [
        f"The pinch gets worse on the finer mesh with {'; '.join(away)}: on the coarse mesh two errors of opposite "
        "sign cancel by accident."
    ]


def _moves_away(rows: Sequence[Row], series: str) -> bool:
    errors = [row.error for row in rows if row.quantity == pinches.FORCE and row.series == series]
    return errors[-1] > errors[0]
