"""How contacts are solved: sweeps, tolerance, and the paper's penalty instead."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from services.mechanics.scenarios import insertion_scene
from services.mechanics.scene import ContactSettings, QualityLevel, SceneModel
from services.studies.accuracy import insertions
from services.studies.accuracy.report import costs_us, number, values
from services.studies.accuracy.study import Draw, Error, Reference, Row, Setting, Tick

TITLE = "Solve of the contacts"
WHAT = (
    "The most sweeps of the implicit solve and its tolerance, and penalty contact of several stiffnesses, in the "
    "insertion. All are compared with the implicit solve at a thousandth of the tolerance and without a limit that "
    "is ever met."
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
    force, cost = values(rows, insertions.FORCE), costs_us(rows)
    series = {row.setting: row.series for row in rows}
    sweeps = [name for name in force if series[name] == _SWEEPS]
    penalties = [name for name in force if series[name] == "penalty"]
    lines = [
        f"Force over the insertion: {', '.join(f'{number(force[name])} % at {name}' for name in sweeps)}. A solve "
        "that is broken off early starts further away in the next tick, so it saves little time.",
        f"Penalty contact: {', '.join(f'{number(force[name])} % at {name}' for name in penalties)}. At a tick of 1 ms "
        "a particle of 3 mg bears about 1 N/m; what is stiffer shakes, what is softer lets the catheter through.",
    ]
    if sweeps and sweeps[-1] in cost:
        told = ", ".join(f"{cost[name]:.0f} us at {name}" for name in (*sweeps, *penalties))
        lines.append(f"A tick: {told}.")
    return lines
