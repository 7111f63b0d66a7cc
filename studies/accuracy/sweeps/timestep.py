"""How long a step is."""

from __future__ import annotations

from collections.abc import Sequence

from trocar.services.mechanics.scenarios import insertion_scene
from trocar.studies.accuracy import insertions
from trocar.studies.accuracy.report import costs_us, number, values
from trocar.studies.accuracy.study import Draw, Error, Reference, Row, Setting, Tick

TITLE = "Length of the step"
WHAT = (
    "The insertion in steps of 1 ms and shorter. The reference is the same insertion in much shorter steps. The cost "
    "is that of a millisecond, however many steps it takes."
)


def settings(draw: Draw) -> Sequence[Setting]:
    """One series over whole fractions of a millisecond."""
    steps = draw.pick((1, 2), (1, 2), (1, 2, 4, 8))
    return [Setting(f"{1.0 / n:g} ms", {"dt_s": insertions.TICK_S / n}) for n in steps]


def reference(draw: Draw) -> Reference:
    """Return the insertion in the shortest steps."""
    shortest_s = draw.pick(2.5e-4, 1.25e-4, 3.125e-5)
    return insertions.insertion_reference(insertion_scene(), draw, shortest_s)


def errors(setting: Setting, reference: Reference, draw: Draw) -> dict[str, Error]:
    """The insertion's."""
    return insertions.insertion_errors(insertion_scene(), reference, draw, float(setting.choices["dt_s"]))


def tick(setting: Setting, draw: Draw) -> Tick:
    """A millisecond of the insertion."""
    return insertions.insertion_tick(insertion_scene(), draw, float(setting.choices["dt_s"]))


def findings(rows: Sequence[Row]) -> list[str]:
    """Say what shorter steps buy and cost."""
    force, cost = values(rows, insertions.FORCE), costs_us(rows)
    names = list(force)
    if names[0] not in cost:
        return []
    times = cost[names[-1]] / cost[names[0]]
    told = f"{names[-1]} instead of {names[0]} take {times:.1f} times as long, for an error of the force of"
    return [f"Steps of {told} {number(force[names[-1]])} % instead of {number(force[names[0]])} %."]
