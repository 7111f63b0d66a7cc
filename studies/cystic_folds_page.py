"""docs/results/cystic-folds.md: what the folds of drawn cystic ducts do to a catheter, in words and tables."""

from __future__ import annotations

import platform
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from trocar.services.mechanics.scene.cystic_duct import CysticDuctScene
from trocar.studies.provenance import code_version
from trocar.studies.rates import interval

if TYPE_CHECKING:
    from trocar.studies.cystic_folds import Run

_ROOT = Path(__file__).resolve().parents[1]
_STEP_MM = 2.0
_WHAT = """\
A drive pushes a 5 Fr catheter, its last 15 mm bent by 21°, into [drawn cystic ducts](../reference/cystic-duct.md) at
20 mm/s, from an introducer without friction or seal: what the hand feels is the tissue's alone. The neck is held. The
wall has a modulus of 500 kPa (porcine bile duct: shear 166 ± 67 kPa, PMC6925591, from Duch 2004). Assumptions are its
1 mm, as in the default scene, friction of 0.1, the bend of the tip, the height of folds, and the {limit_mn:.0f} mN at
which a hand gives up. A hand that turns draws back 3 mm there, turns by 137.5° and tries again, up to eight times at
one fold; one that pulls has pulled the neck with 0.29 N before and holds it there (`duct.traction_n`). A straight tip
is turned in the same way. An insertion has passed when the tip is 2 mm beyond the folds.
"""


def write_page(
    path: Path,
    runs: Sequence[Run],
    drawn_duct: Callable[[int], CysticDuctScene],
    hands: tuple[Mapping[str, str], float],
    stiffness: Mapping[int, Mapping[str, list[list[float]]]],
) -> None:
    """Write the page of all runs; ``hands`` are their kinds and their limit, ``stiffness`` that of folds by mesh."""
    kinds, limit_n = hands
    usual = [run for run in runs if not run.how]
    seeds = sorted({run.seed for run in usual})
    of = {(run.seed, run.kind): run for run in usual}
    lines = [
        "# Folds of the cystic duct",
        "",
        f"Written by `python -m trocar.studies.cystic_folds --page`, {datetime.now(UTC):%Y-%m-%d}, code",
        f"{code_version(_ROOT)}, Python {platform.python_version()}; do not edit by hand.",
        "",
        _WHAT.format(limit_mn=1e3 * limit_n),
        *_shares(usual, kinds, len(seeds)),
        *_depths(usual, kinds),
        *_seeds(seeds, of, kinds, drawn_duct),
        *_finer(runs, of),
        *_stiffness(stiffness),
    ]
    path.write_text("\n".join(lines), encoding="utf-8")


def _shares(runs: Sequence[Run], kinds: Mapping[str, str], n: int) -> list[str]:
    lines = [
        f"## {n} seeds",
        "",
        "Intervals have 95 % confidence. The largest force is that of each insertion: median, smallest and largest.",
        "",
        "| hand | passed | share | tries again, in all | largest force, mN |",
        "| --- | --- | --- | --- | --- |",
    ]
    for kind, what in kinds.items():
        these = [run for run in runs if run.kind == kind]
        passed = sum(run.passed for run in these)
        low, high = interval(passed, len(these))
        peaks = [max(run.force_mn) for run in these]
        lines.append(
            f"| {what} | {passed} of {len(these)} | {100 * low:.0f} to {100 * high:.0f} % | "
            f"{sum(run.tries for run in these)} | {np.median(peaks):.0f} ({min(peaks):.0f} to {max(peaks):.0f}) |"
        )
    return [*lines, ""]


def _depths(runs: Sequence[Run], kinds: Mapping[str, str]) -> list[str]:
    deepest = max(max(run.depth_mm) for run in runs)
    bins = np.arange(0.0, deepest + _STEP_MM, _STEP_MM)
    lines = [
        "## Force against depth",
        "",
        "The largest force of an insertion while its tip is so deep, in mN: median and largest of the insertions that",
        "came so far, and in brackets how many did.",
        "",
        f"| depth, mm | {' | '.join(kinds.values())} |",
        f"| --- |{' --- |' * len(kinds)}",
    ]
    for low in bins[:-1]:
        cells = []
        for kind in kinds:
            peaks = []
            for run in (each for each in runs if each.kind == kind):
                depth = np.array(run.depth_mm)
                here = np.array(run.force_mn)[(depth >= low) & (depth < low + _STEP_MM) & (depth > 0.0)]
                peaks += [float(here.max())] if here.size else []
            cells.append(f"{np.median(peaks):.0f}, {max(peaks):.0f} ({len(peaks)})" if peaks else "")
        lines.append(f"| {low:.0f} to {low + _STEP_MM:.0f} | {' | '.join(cells)} |")
    return [*lines, ""]


def _seeds(
    seeds: Sequence[int],
    of: Mapping[tuple[int, str], Run],
    kinds: Mapping[str, str],
    drawn_duct: Callable[[int], CysticDuctScene],
) -> list[str]:
    lines = [
        "## Each duct",
        "",
        "*Beside* is the width that one fold leaves open, where it is least; length and width are in mm, too. A",
        "number is the largest force in mN; then where the tip stopped, or how often the hand tried again before it",
        "passed.",
        "",
        f"| seed | course | length | width | folds | height | beside | {' | '.join(kinds.values())} |",
        f"| --- | --- | --- | --- | --- | --- | --- |{' --- |' * len(kinds)}",
    ]
    for seed in seeds:
        duct = drawn_duct(seed)
        assert duct.length_m is not None
        assert duct.width_m is not None
        assert duct.end_width_m is not None
        assert duct.fold_height is not None
        half_mm = 0.5e3 * min(duct.width_m, 0.5 * (duct.width_m + duct.end_width_m))  # where there are folds
        told = [_told(of[seed, kind]) for kind in kinds]
        lines.append(
            f"| {seed} | {duct.course} | {1e3 * duct.length_m:.0f} | {1e3 * duct.width_m:.1f} to "
            f"{1e3 * duct.end_width_m:.1f} | {duct.folds} | {duct.fold_height:.2f} | "
            f"{half_mm * (2.0 - duct.fold_height):.1f} | "
            f"{' | '.join(told)} |"
        )
    return [*lines, ""]


def _told(run: Run) -> str:
    end = f"passes, {run.tries}" if run.passed else f"stops at {max(run.depth_mm):.0f} mm"
    return f"{max(run.force_mn):.0f}; {end}"


def _finer(runs: Sequence[Run], of: Mapping[tuple[int, str], Run]) -> list[str]:
    finer = [run for run in runs if run.how]
    if not finer:
        return []
    lines = [
        "## Finer",
        "",
        "The push again, on a finer mesh and with shorter steps; force and work are those over the depth that both",
        "came to. Where a push stops, that is on the flank of a fold, and a small shift changes both by much.",
        "",
        "| seed | what | passed | largest force, mN | change | work, mJ | change |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for run in finer:
        usual = of[run.seed, run.kind]
        to_mm = min(max(run.depth_mm), max(usual.depth_mm))
        peaks = [_over(each, to_mm)[0] for each in (usual, run)]
        works = [_over(each, to_mm)[1] for each in (usual, run)]
        lines.append(
            f"| {run.seed} | {run.how} | {', '.join('yes' if each.passed else 'no' for each in (usual, run))} | "
            f"{peaks[0]:.0f}, {peaks[1]:.0f} | {100 * (peaks[1] / peaks[0] - 1):+.1f} % | "
            f"{works[0]:.2f}, {works[1]:.2f} | {100 * (works[1] / works[0] - 1):+.1f} % |"
        )
    return [*lines, ""]


def _over(run: Run, to_mm: float) -> tuple[float, float]:
    """Return the largest force in mN of a push to a depth, and its work in mJ."""
    depth, force = np.array(run.depth_mm), np.array(run.force_mn)
    here = depth <= to_mm
    return float(force[here].max()), 1e-3 * float(np.trapezoid(force[here], depth[here]))


def _stiffness(stiffness: Mapping[int, Mapping[str, list[list[float]]]]) -> list[str]:
    """Return the table of how stiff folds are by the mesh, the force at a stated deflection."""
    if not stiffness:
        return []
    lines = [
        "## How stiff the folds are",
        "",
        "A pressure on the area of a tip, 0.6 mm in radius, pushes the crest of each fold: the force by the",
        "deflection, in N/mm, statically, on edges as long as the default's and shorter. A crest that the common duct",
        "has taken in is left out. The change is that to the finest mesh, of the fold that changes most.",
        "",
        "| seed | push | edges 1 | 0.7 | 0.5 | change |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for seed, of_mesh in sorted(stiffness.items()):
        for side, name in enumerate(("along the duct", "outwards")):
            values = [1e-3 * np.array(of_mesh[share][side]) for share in ("1", "0.7", "0.5")]
            change = values[2] / values[0] - 1.0
            told = [", ".join(f"{x:.3f}" for x in each) for each in values]
            most = 100.0 * float(change[np.argmax(np.abs(change))])
            lines.append(f"| {seed} | {name} | {' | '.join(told)} | {most:+.1f} % |")
    return [*lines, ""]
