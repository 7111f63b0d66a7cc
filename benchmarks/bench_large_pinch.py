"""A pinch with large displacements, in turns with CalculiX (S8R) on as many nodes.

python benchmarks/bench_large_pinch.py

The reference duct, clamped at one end, is closed by half at its mouth by jaws 4 mm wide, in ten equal steps of load.
Both run as one thread. Debian's ``ccx`` is needed.
"""

from __future__ import annotations

import os

# Before numpy is loaded, and for ccx: one thread each.
os.environ["OPENBLAS_NUM_THREADS"] = os.environ["OMP_NUM_THREADS"] = "1"

import itertools
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.report import Row, parse, write_report
from trocar.services.mechanics.fem.nonlinear import PathSettings, trace_path
from trocar.studies.published.large_displacements import squeezed_duct

STEPS = 10
#: Triangles round and along, and quadrilaterals of eight nodes round and along: as many nodes each.
MESHES = ((24, 36), (12, 24)), ((48, 60), (24, 40))
RADIUS_M, LENGTH_M, JAW_M, CLOSED_M = 0.004, 0.04, 0.004, 0.002
NOTES = """The reference duct, clamped at one end, is closed by half at its mouth by jaws 4 mm wide, in ten equal steps.
CalculiX has elements of eight nodes (S8R), ours are triangles: at 888 nodes the jaws are not as wide to a node."""
_DECK = """*NODE, NSET=ALL
{nodes}
*ELEMENT, TYPE=S8R, ELSET=DUCT
{elements}
*NSET, NSET=HELD
{held}
*NSET, NSET=UPPER
{upper}
*NSET, NSET=LOWER
{lower}
*MATERIAL, NAME=WALL
*ELASTIC
1e5, 0.45
*SHELL SECTION, ELSET=DUCT, MATERIAL=WALL
0.5e-3
*BOUNDARY
HELD, 1, 6
*STEP, NLGEOM, INC=100
*STATIC, DIRECT
{step}, 1.
*BOUNDARY
UPPER, 2, 2, -{closed:e}
LOWER, 2, 2, {closed:e}
*NODE PRINT, NSET=LOWER, TOTALS=ONLY, FREQUENCY={steps}
RF
*END STEP
"""


def ours(around: int, along: int) -> tuple[float, float]:
    """Seconds of the whole path, and the force (N) that holds one jaw at its end."""
    began_s = time.perf_counter()
    problem = squeezed_duct(around, along)
    path = trace_path(problem.shell, problem.load, PathSettings(n_steps=STEPS))
    return time.perf_counter() - began_s, abs(float(path[-1].reaction[problem.watched, 1].sum()))


def calculix(around: int, along: int) -> tuple[float, float]:
    """The same of ``ccx``, whose time holds its start and the files it reads and writes.

    Raises RuntimeError: it did not come to the full load.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "pinch.inp").write_text(_deck(around, along), encoding="ascii")
        began_s = time.perf_counter()
        said = subprocess.run(["ccx", "pinch"], cwd=folder, capture_output=True, text=True, check=False).stdout
        elapsed_s = time.perf_counter() - began_s
        totals = (folder / "pinch.dat").read_text(encoding="ascii")
    rows = re.findall(r"^\s+(\S+E\S+)\s+(\S+E\S+)\s+(\S+E\S+)\s*$", totals, re.MULTILINE)
    if not rows:
        raise RuntimeError(f"ccx: no force of the jaw; it said last: {said[-300:]}")
    return elapsed_s, abs(float(rows[-1][1]))


def _deck(around: int, along: int) -> str:
    number: dict[tuple[int, int], int] = {}
    for i, j in itertools.product(range(2 * along + 1), range(2 * around)):
        if i % 2 == 0 or j % 2 == 0:  # an element of eight nodes has none in its middle
            number[i, j] = len(number) + 1
    corners = (0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1)
    quads = itertools.product(range(0, 2 * along, 2), range(0, 2 * around, 2))
    elements = [[number[i + a, (j + b) % (2 * around)] for a, b in corners] for i, j in quads]
    jaw = [i for i in range(2 * along + 1) if (2 * along - i) * LENGTH_M <= (JAW_M + 1e-9) * 2 * along]
    sides = [[number[i, side] for i in jaw if (i, side) in number] for side in (around // 2, 3 * around // 2)]
    lower, upper = sides
    return _DECK.format(
        nodes="\n".join(f"{n}, {x:.9e}, {y:.9e}, {z:.9e}" for n, (x, y, z) in _placed(number, around, along)),
        elements="\n".join(", ".join(map(str, [n + 1, *each])) for n, each in enumerate(elements)),
        held="\n".join(str(number[0, j]) for j in range(2 * around)),
        upper="\n".join(map(str, upper)),
        lower="\n".join(map(str, lower)),
        step=1.0 / STEPS,
        steps=STEPS,
        closed=CLOSED_M,
    )


def _placed(
    number: dict[tuple[int, int], int], around: int, along: int
) -> Iterator[tuple[int, tuple[float, float, float]]]:
    for (i, j), n in number.items():
        angle = np.pi * j / around
        yield n, (LENGTH_M * i / (2 * along), -RADIUS_M * float(np.sin(angle)), RADIUS_M * float(np.cos(angle)))


def main() -> None:
    """Solve each pinch in turns, and write the table."""
    given = parse(__doc__, repeats=(3, "turns of each"))
    if shutil.which("ccx") is None:
        sys.exit("bench_large_pinch: ccx is not installed (Debian: calculix-ccx)")
    rows = []
    for triangles, quads in MESHES:
        pairs = [(ours(*triangles), calculix(*quads)) for _ in range(given.repeats)]
        nodes = triangles[0] * (triangles[1] + 1)
        ratio = statistics.median(a[0] / b[0] for a, b in pairs)
        rows += [
            Row(f"{nodes} nodes, ours", statistics.median(a[0] for a, _ in pairs), "s"),
            Row(f"{nodes} nodes, CalculiX", statistics.median(b[0] for _, b in pairs), "s"),
            Row(f"{nodes} nodes, ours over CalculiX", ratio, "", limit=2.0, note="median of turns"),
            Row(f"{nodes} nodes, force of a jaw over CalculiX's", pairs[-1][0][1] / pairs[-1][1][1], ""),
        ]
    print(*write_report("large_pinch", "A pinch with large displacements, beside CalculiX", rows, NOTES))


if __name__ == "__main__":
    main()
