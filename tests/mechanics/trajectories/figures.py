"""What a run is known by, as text: a line for each quantity, with its tolerance, its means over time and its extreme.

Means over a quarter of a second do not depend on the tick in which a wall slips from jaws, single ticks do. A tolerance
is `MARGIN` times the most by which runs differ that differ by rounding alone, and not below what `FLOOR` says:

- every state moved by a rounding error before every tick, as other processors and libraries round sums otherwise;
- a start that is elsewhere by 1e-12 of its place;
- modes of the wall that OpenBLAS has computed by its kernels for other processors, as other versions of it round.

So it allows any change of the order of sums. What a line must catch is a change of behaviour: the tests break the
mechanics a little (a wall softer by 1 %, more friction by 5 %, less damping) and want it to be noticed.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from .cases import DT_S, TICKS
from .observe import Run

FloatArray = npt.NDArray[np.float64]

FOLDER = Path(__file__).parent / "recorded"
WINDOW_TICKS = 250
MARGIN = 4.0
#: Far below what is seen (0.1 mm) or felt (1 mN), by the unit at the end of a name.
FLOOR = {"_m": 1e-9, "_n": 1e-7, "_nm": 1e-9, "_j": 1e-12, "_m_s": 1e-9, "_rad": 1e-9, "contacts": 0.1}
#: Of a line's largest number: what other libraries may move that was not tried. Breaks move some line by 1e-3 and more.
ROUNDED = 1e-4
EXTREMES = ("wall_m", "strain_j", "contact_n", "tool0_n", "tool1_n", "jaw0_nm", "jaw1_nm", "inserted_m")
_HEAD = f"""\
# Written by `python -m tests.mechanics.trajectories record {{name}}`, see figures.py. Each line: a quantity, its
# tolerance, its means over {WINDOW_TICKS * DT_S} s each of {TICKS * DT_S} s; `most` is its largest amount. SI units.
"""


@dataclass
class Line:
    """A quantity of a run: its numbers, and by how much each may differ."""

    tolerance: float
    values: FloatArray


def summary(run: Run) -> dict[str, FloatArray]:
    """Return the numbers of each line of a run."""
    means = {name: values.reshape(-1, WINDOW_TICKS).mean(axis=1) for name, values in run.figures.items()}
    return means | {f"{name}.most": np.array([np.abs(run.figures[name]).max()]) for name in EXTREMES}


def departures(found: dict[str, FloatArray], lines: dict[str, Line]) -> dict[str, float]:
    """Return by how many tolerances each quantity departs from what was recorded, the most of all moments.

    Raises
    ------
    ValueError
        The quantities are not those that were recorded.
    """
    if found.keys() != lines.keys():
        raise ValueError(f"other quantities were recorded: {sorted(found.keys() ^ lines.keys())}")
    return {
        name: float(np.abs(values - lines[name].values).max() / lines[name].tolerance) for name, values in found.items()
    }


def tolerances(plain: dict[str, FloatArray], others: list[dict[str, FloatArray]]) -> dict[str, float]:
    """Return the tolerance of each quantity from runs that differ by rounding alone."""
    found = {}
    for name, values in plain.items():
        apart = max(float(np.abs(other[name] - values).max()) for other in others)
        unit = max((end for end in FLOOR if name.removesuffix(".most").endswith(end)), key=len)
        found[name] = max(MARGIN * apart, FLOOR[unit], ROUNDED * float(np.abs(values).max()))
    return found


def path_of(name: str) -> Path:
    """Return the file of a case."""
    return FOLDER / f"{name}.txt"


def text(name: str, lines: dict[str, Line]) -> str:
    """Return the content of a case's file."""
    rows = (
        " ".join([f"{key:18}", f"{line.tolerance:.1e}", *(f"{value + 0.0:13.6e}" for value in line.values)])
        for key, line in lines.items()
    )
    return _HEAD.format(name=name) + "".join(f"{row}\n" for row in rows)


def read(name: str) -> dict[str, Line]:
    """Read what `text` wrote."""
    rows = (row.split() for row in path_of(name).read_text().splitlines() if not row.startswith("#"))
    return {key: Line(float(tolerance), np.array(values, np.float64)) for key, tolerance, *values in rows}
