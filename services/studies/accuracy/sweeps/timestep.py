"""How long a step is."""

from __future__ import annotations

from collections.abc import Sequence

from services.mechanics.scenarios import insertion_scene
from services.studies.accuracy import insertions
from services.studies.accuracy.report import costs_us, number, values
from services.studies.accuracy.study import Draw, Error, Reference, Row, Setting, Tick

TITLE = "Length of the step"
WHAT = (
    "Steps a millisecond in the insertion: what is timed is a millisecond of the scene, however many steps it takes. "
    "All are compared with the same insertion in much shorter steps."
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
    lines = [f"Force over the insertion: {', '.join(f'{number(error)} % at {name}' for name, error in force.items())}."]
    names = list(force)
    if names[0] in cost:
        times = cost[names[-1]] / cost[names[0]]
        lines.append(
            f"A millisecond in steps of {names[-1]} takes {times:.1f} times as long as in steps of {names[0]}."
        )
    return lines
