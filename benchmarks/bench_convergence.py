"""How errors fall with the length of the step: a released cantilever's tip, and the forces of the insertion.

    python benchmarks/bench_convergence.py

Nothing is timed: the numbers are the same on every machine but for rounding.
"""

from __future__ import annotations

import tempfile
from itertools import pairwise
from pathlib import Path

import numpy as np
from report import Row, parse, write_report

from trocar.services.mechanics.rod.implicit import SPECTRAL_RADIUS
from trocar.studies.insertion_steps import insert, rms
from trocar.studies.published.rod_dynamics import spin, tip_errors_m

STEPS_S = (1e-3, 5e-4, 2.5e-4)
FINEST_S = 6.25e-5
SLIDING = slice(1000, 1900)  # ms of the scripted insertion


def errors(what: str, values: list[float], unit: str, note: str = "") -> list[Row]:
    rows = [Row(f"{what} at {1e3 * s:g} ms", v, unit, note=note) for s, v in zip(STEPS_S, values, strict=True)]
    orders = [float(np.log2(coarse / fine)) for coarse, fine in pairwise(values)]
    steps = [f"{1e3 * a:g} to {1e3 * b:g} ms" for a, b in pairwise(STEPS_S)]
    return rows + [Row(f"{what}, observed order, {s}", order, "") for s, order in zip(steps, orders, strict=True)]


def insertion_rows() -> list[Row]:
    with tempfile.TemporaryDirectory() as cache:
        finest = insert(FINEST_S, Path(cache))
        runs = [insert(dt_s, Path(cache)) for dt_s in STEPS_S]
    force = [1e3 * rms(run.force_n - finest.force_n) for run in runs]
    sliding = [1e3 * rms((run.force_n - finest.force_n)[SLIDING]) for run in runs]
    tip = [1e3 * rms(run.tip_m - finest.tip_m) for run in runs]
    apart = [1e3 * abs(run.length_m - finest.length_m) for run in runs]
    of = f"of {1e3 * rms(finest.force_n):.3g} mN"
    return [
        *errors("insertion, force on a tool", force, "mN", of),
        *errors("insertion, force on a tool while it slides in", sliding, "mN"),
        *errors("insertion, tip", tip, "mm"),
        *(
            Row(f"insertion, inserted at the end, {1e3 * s:g} ms", a, "mm", 0.1)
            for s, a in zip(STEPS_S, apart, strict=True)
        ),
    ]


def main() -> None:
    parse(__doc__)
    tip = [1e3 * float(error) for error in tip_errors_m(STEPS_S, SPECTRAL_RADIUS)]
    rows = errors("released cantilever, tip", tip, "mm")
    for rate in (20.0, 100.0):
        kept = 100.0 * spin(rate, SPECTRAL_RADIUS).momentum
        rows.append(Row(f"free rod, angular momentum kept in 0.5 s at {rate:g} rad/s", kept, "%", 99.0, at_least=True))
    notes = (
        "Root mean square errors. The cantilever is let go from a bend of 17 mm and followed for 0.3 s, against the "
        "midpoint rule at 10 us; the insertion takes 2.2 s, against itself at 62.5 us, where touches that begin a tick "
        "earlier or later make most of the error. Away from contact the catheter's step is of second order (spectral "
        f"radius {SPECTRAL_RADIUS:g}); contacts, grips and couplings are implicit Euler's."
    )
    write_report("convergence", "Convergence in the time step", rows + insertion_rows(), notes)


if __name__ == "__main__":
    main()
