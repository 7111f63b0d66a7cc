"""How contacts are solved: sweeps, tolerance, and the paper's penalty instead."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from trocar.services.mechanics.scenarios import insertion_scene
from trocar.services.mechanics.scene import ContactSettings, QualityLevel, SceneModel
from trocar.studies.accuracy import insertions
from trocar.studies.accuracy.report import number, values
from trocar.studies.accuracy.study import Draw, Error, Reference, Row, Setting, Tick

TITLE = "Solve of the contacts"
WHAT = (
    "The insertion with fewer sweeps of the implicit contact solve, with other tolerances, and with penalty contact. "
    "The reference is the implicit solve at a thousandth of the tolerance, with as many sweeps as that takes."
)
_SWEEPS, _TOLERANCE = "sweeps", "tolerance"


def settings(draw: Draw) -> Sequence[Setting]:
    """A series a way of solving."""
    sweeps = draw.pick((5, 30), (1, 2, 5, 10, 30), (1, 2, 3, 5, 10, 20, 30, 60))
    tolerances = draw.pick((), (1e-4, 1e-5), (1e-3, 1e-4, 1e-5, 1e-7))
    stiffnesses = draw.pick((50.0,), (1.0, 20.0, 200.0), (0.3, 1.0, 5.0, 20.0, 50.0, 100.0, 200.0))
    return [
        *(Setting(f"{n} sweeps", {"quality.0.iterations": n}, _SWEEPS) for n in sweeps),
        *(Setting(f"tolerance {t:g} N", {"contact.tolerance_n": t}, _TOLERANCE) for t in tolerances),
        *(
            Setting(f"penalty {k:g} N/m", {"contact.model": "penalty", "contact.penalty_stiffness_n_m": k}, "penalty")
            for k in stiffnesses
        ),
    ]


def reference(draw: Draw) -> Reference:
    """Return the insertion with contacts solved to the end."""
    exact = ContactSettings(tolerance_n=1e-9)
    return insertions.insertion_reference(_scene(exact, draw.pick(100, 1000, 1000)), draw)


def errors(setting: Setting, reference: Reference, draw: Draw) -> dict[str, Error]:
    """The insertion's."""
    return insertions.insertion_errors(_chosen(setting), reference, draw)


def tick(setting: Setting, draw: Draw) -> Tick:
    """A tick of the insertion."""
    return insertions.insertion_tick(_chosen(setting), draw)


def _chosen(setting: Setting) -> SceneModel:
    choices, default = setting.choices, ContactSettings()
    if "contact.penalty_stiffness_n_m" in choices:
        stiffness = float(choices["contact.penalty_stiffness_n_m"])
        return _scene(replace(default, model="penalty", penalty_stiffness_n_m=stiffness))
    tolerance = float(choices.get("contact.tolerance_n", default.tolerance_n))
    sweeps = int(choices.get("quality.0.iterations", QualityLevel().iterations))
    return _scene(replace(default, tolerance_n=tolerance), sweeps)


def _scene(contact: ContactSettings, sweeps: int = 30) -> SceneModel:
    return replace(insertion_scene(), contact=contact, quality=(QualityLevel(iterations=sweeps),))


def findings(rows: Sequence[Row]) -> list[str]:
    """Say how far sweeps have to go, and what penalty contact comes to."""
    force = values(rows, insertions.FORCE)
    series = {row.setting: row.series for row in rows}
    penalties = [name for name in force if series[name] == "penalty"]
    lines = [
        "A solve that is broken off early starts further from the solution in the next tick, so it saves little time.",
    ]
    if penalties:
        lines.append(
            f"No penalty stiffness works (errors of {number(min(force[name] for name in penalties))} % and more): at a "
            "tick of 1 ms a particle of 3 mg is stable up to about 1 N/m. Stiffer contact shakes, softer contact lets "
            "the catheter through."
        )
    return lines
