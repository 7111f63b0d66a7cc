"""Shells of the literature on large displacements, through `trocar fem` as docs/explanation/fem.md describes it.

python benchmarks/bench_published_shells.py                  # ten minutes; writes results/published-shells.md
python benchmarks/bench_published_shells.py slit-annulus         # some of configs/fem/published; writes nothing
python benchmarks/bench_published_shells.py slit-annulus --page  # writes the page with these alone

Each file is solved by the command itself; its JSON is compared with the published table at every point of the path.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from resource import RUSAGE_CHILDREN, getrusage
from typing import Any

import numpy as np
from numpy.typing import NDArray
from published_shells import PATHS, Published
from report import commit

from trocar.services.mechanics.arrays import FloatArray
from trocar.studies.published.large_displacements import ROOF_PATHS, off_the_path

ROOT = Path(__file__).resolve().parents[1]
CASES = ROOT / "configs" / "fem" / "published"
PAGE = ROOT / "benchmarks" / "results" / "published-shells.md"
ROOFS = {"hinged-roof-thick": 12.7, "hinged-roof-thin": 6.35}
BY_DISPLACEMENT = {"cylinder-between-diaphragms": (4, 4.0, 12e3)}
"""Support whose displacement is imposed, how many of its forces make up the published one, and the full load."""
SHOWN = (0.5, 1.0)
"""Parts of the load that are printed."""


@dataclass(frozen=True)
class Compared:
    """A case beside its published path: rows to print, and the largest distance."""

    rows: list[str]
    worst: str


def main() -> None:
    """Print the table, and write the page if all cases were asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    known = [path.stem for path in sorted(CASES.glob("*.yaml"))]
    parser.add_argument("cases", nargs="*", help=", ".join(known))
    parser.add_argument(
        "--page", action="store_true", help="write benchmarks/results/published-shells.md, of some cases too"
    )
    given = parser.parse_args()
    for name in given.cases:
        if name not in known:
            parser.error(f"there is no case '{name}'; known: {', '.join(known)}")
    summary = []
    for name in given.cases or known:
        result, seconds = solve(name)
        compared = compare(name, result["path"]["points"])
        triangles, n_points = result["mesh"]["triangles"], len(result["path"]["points"])
        source = PATHS[name].source if name in PATHS else Published.source
        about = f"| `{name}` | {triangles} | {n_points} | {seconds:.0f} | {compared.worst} | {source} |"
        print(about, *compared.rows, sep="\n", flush=True)
        summary.append(about)
    if given.page or not given.cases:
        left_out = [name for name in known if given.cases and name not in given.cases]
        PAGE.write_text("\n".join([*_about(), *summary, "", *_not_run(left_out)]))


def solve(name: str) -> tuple[dict[str, Any], float]:
    """What `trocar fem` writes for a case, and how many seconds of processor it takes."""
    with tempfile.TemporaryDirectory() as folder:
        out, start_s = Path(folder) / "out.json", getrusage(RUSAGE_CHILDREN).ru_utime
        command = [
            sys.executable,
            "-m",
            "trocar.services.cli.app",
            "fem",
            str(CASES / f"{name}.yaml"),
            "--json",
            str(out),
        ]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, cwd=ROOT)
        return json.loads(out.read_text()), getrusage(RUSAGE_CHILDREN).ru_utime - start_s


def compare(name: str, points: list[dict[str, Any]]) -> Compared:
    """Put a path beside the published one."""
    if name in ROOFS:
        return _roof(name, points)
    published = PATHS[name]
    if name in BY_DISPLACEMENT:
        return _by_displacement(name, points, published)
    return _by_part(name, points, published)


def _by_part(name: str, points: list[dict[str, Any]], published: Published) -> Compared:
    """What has moved at the same parts of the load; errors are over the largest that a column comes to.

    Where a load step was halved the published part may lie between two points: there the path is taken as straight.
    """
    parts, values = published.values[:, 0], published.values[:, 1:]
    own = np.array([0.0, *(point["part"] for point in points)])
    columns = [[0.0, *(_component(point, column) for point in points)] for column in published.columns[1:]]
    moved = np.stack([np.interp(parts, own, column) for column in columns], axis=1)
    errors = 100.0 * (moved - values) / np.abs(values).max(axis=0)
    rows = [
        f"| {name} | {parts[k]:g} | {column.lstrip('-')} | {got:.4g} | {value:.4g} | {error:+.2f} |"
        for k in np.flatnonzero(np.isin(parts, SHOWN))
        for column, got, value, error in zip(published.columns[1:], moved[k], values[k], errors[k], strict=True)
    ]
    off = np.abs(errors)
    return Compared(rows, f"{off.max():.2f} % of the largest displacement, median {np.median(off):.2f} % ({off.size})")


def _by_displacement(name: str, points: list[dict[str, Any]], published: Published) -> Compared:
    """What the force is at the published displacements, between the points of the own path."""
    support, times, full = BY_DISPLACEMENT[name]
    moved = np.array([_component(point, published.columns[1]) for point in points])
    force = np.array([np.linalg.norm(point["support_force_n"][support]) for point in points]) * times / full
    beside = np.array([_component(point, published.columns[2]) for point in points])
    at = published.values[:, 1]
    parts, others = (np.interp(at, np.append(0.0, moved), np.append(0.0, what)) for what in (force, beside))
    errors = 100.0 * (parts - published.values[:, 0])
    off = 100.0 * (others - published.values[:, 2]) / np.abs(published.values[:, 2]).max()
    rows = []
    for k, part in enumerate(published.values[:, 0]):
        if part in SHOWN:
            given = f"| {name}, moved by {at[k]:g} | {part:g} |"
            rows += [
                f"{given} part of the load | {parts[k]:.4g} | {part:.4g} | {errors[k]:+.2f} |",
                f"{given} {published.columns[2]} | {others[k]:.4g} | {published.values[k, 2]:.4g} | {off[k]:+.2f} |",
            ]
    both = np.abs(np.append(errors, off))
    return Compared(
        rows, f"{both.max():.2f} % of the full load or displacement, median {np.median(both):.2f} % ({len(both)})"
    )


def _roof(name: str, points: list[dict[str, Any]]) -> Compared:
    """How far the published points lie from the own path, which falls and turns back."""
    published: FloatArray = ROOF_PATHS[ROOFS[name]]
    own = np.array([(0.0, 0.0), *((point["part"], -point["probes"]["middle"][0]) for point in points)])
    off = 100.0 * off_the_path(published, own)
    limit, lowest = _extremes(own[:, 0])
    rows = [
        f"| {name} | {what} | part of the load | {got:.4g} | {value:.4g} | {100.0 * (got - value):+.2f} |"
        for what, got, value in zip(("limit", "lowest"), (limit, lowest), _extremes(published[:, 0]), strict=True)
    ]
    return Compared(rows, f"{off.max():.2f} % off the path, median {np.median(off):.2f} % ({len(off)})")


def _extremes(part: NDArray[np.float64]) -> tuple[float, float]:
    """The first load from which it falls, and the lowest after it."""
    top = int(np.flatnonzero(np.diff(part) < 0.0)[0])
    return float(part[top]), float(part[top:].min())


def _component(point: dict[str, Any], column: str) -> float:
    """What a column of a table is at a point: ``-A.x`` is how far probe A has moved against x."""
    probe, axis = column.lstrip("-").split(".")
    moved = float(point["probes"][probe]["xyz".index(axis)])
    return -moved if column.startswith("-") else moved


def _not_run(names: list[str]) -> list[str]:
    return [f"Not run this time: {', '.join(names)}.", ""] if names else []


def _about() -> list[str]:
    return [
        "# Published shells at large displacements",
        "",
        "Made by `python benchmarks/bench_published_shells.py`; do not edit by hand. `trocar fem` solves every file of",
        "`configs/fem/published`, and each is compared with all points of its published table. Some of them are",
        "in [Verification](../../docs/results/verification.md#shells-at-large-displacements), on several meshes. "
        "Seconds are processor",
        f"time of the whole command. {datetime.now(UTC):%Y-%m-%d}, code {commit()}.",
        "",
        "| case | triangles | points | seconds | largest distance from the published table (points) | source |",
        "|---|---|---|---|---|---|",
    ]


if __name__ == "__main__":
    main()
