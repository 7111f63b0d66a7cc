"""A tube pinched by two rigid lines along it, as a solid in CalculiX and as a shell: the force per displacement.

A line is a row of narrow strips, each pressed evenly; together they move the middle of the wall alike.
"""

from __future__ import annotations

import itertools
import re
import subprocess
from pathlib import Path

import numpy as np

from tests.mechanics.fem.solid_tube import (
    HALF_LENGTH,
    POISSON,
    RADIUS_M,
    YOUNG_PA,
    element,
    graded,
    shares,
    with_middles,
)
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.fem import ElementChoice, ShellModel, ShellSection, Support
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.services.mechanics.surface.tube import alternating_triangles

STRIPS = 4
"""From the middle of the line to its end."""
HALF_ANGLE, HALF_LINE = 0.1, 0.5
"""Of the line: half of its width in rad, and of its length in radii."""


def solid_stiffness(radius_over_thickness: float, folder: Path) -> float:
    """Force in N on one line per metre that the wall's middle gives way under it."""
    t = RADIUS_M / radius_over_thickness
    x = with_middles(graded(HALF_LINE, HALF_LENGTH, STRIPS, 10))
    angle = with_middles(graded(HALF_ANGLE, np.pi / 2, 2, 16))
    radius = np.linspace(RADIUS_M - t / 2, RADIUS_M + t / 2, 9)
    shape = len(x), len(angle), len(radius)
    every = (at for at in itertools.product(*map(range, shape)) if sum(i % 2 for i in at) <= 1)
    number = {at: k + 1 for k, at in enumerate(every)}
    cells = list(itertools.product(*(range(0, size - 1, 2) for size in shape)))
    sets = {
        "MIDDLE": [n for (i, _, _), n in number.items() if i == 0],
        "END": [n for (i, _, _), n in number.items() if i == shape[0] - 1],
        "TOP": [n for (_, j, _), n in number.items() if j == 0],
        "SIDE": [n for (_, j, _), n in number.items() if j == shape[1] - 1],
        "WATCHED": [number[2 * q, 0, 4] for q in range(STRIPS + 1)],
    }
    lines = ["*NODE, NSET=ALL"]
    for (i, j, r), k in number.items():
        y, z = radius[r] * np.cos(angle[j]), radius[r] * np.sin(angle[j])
        lines.append(f"{k}, {RADIUS_M * x[i]:.9e}, {y:.9e}, {z:.9e}")
    lines += ["*ELEMENT, TYPE=C3D20R, ELSET=WALL", *(element(k + 1, cell, number) for k, cell in enumerate(cells))]
    for strip in range(STRIPS):
        on_it = (k + 1 for k, (i, j, r) in enumerate(cells) if i == 2 * strip and j < 4 and r == shape[2] - 3)
        lines += [f"*ELSET, ELSET=STRIP{strip}", *map(str, on_it)]
    for name, members in sets.items():
        lines += [f"*NSET, NSET={name}", *map(str, members)]
    lines += ["*MATERIAL, NAME=WALL", "*ELASTIC", f"{YOUNG_PA}, {POISSON}", "*SOLID SECTION, ELSET=WALL, MATERIAL=WALL"]
    lines += ["*BOUNDARY", "MIDDLE, 1, 1", "SIDE, 2, 2", "TOP, 3, 3", "END, 1, 3"]
    for strip in range(STRIPS):
        lines += ["*STEP", "*STATIC", "*DLOAD, OP=NEW", f"STRIP{strip}, P2, 1.0", "*NODE PRINT, NSET=WATCHED", "U"]
        lines.append("*END STEP")
    (folder / "line.inp").write_text("\n".join(lines), encoding="ascii")
    subprocess.run(["ccx", "line"], cwd=folder, capture_output=True, text=True, timeout=300, check=False)
    rows = re.findall(r"^\s+\d+\s+\S+\s+(\S+)\s+\S+\s*$", (folder / "line.dat").read_text(), re.MULTILINE)
    moved = -np.array(rows, np.float64).reshape(STRIPS, STRIPS + 1)
    strip_n = 4.0 * HALF_LINE * RADIUS_M / STRIPS * (RADIUS_M + t / 2) * np.sin(HALF_ANGLE)
    return _stiffness(moved, strip_n)


def shell_stiffness(radius_over_thickness: float, bending: str, refine: int = 4) -> float:
    """The same of a shell."""
    half = graded(HALF_LINE, HALF_LENGTH, STRIPS * refine, 3 * STRIPS * refine // 2)
    x = np.concatenate([-half[:0:-1], half])
    quarter = graded(HALF_ANGLE, np.pi / 2, 4, 24)
    top = np.concatenate([-quarter[:0:-1], quarter])
    X, A = np.meshgrid(x, np.concatenate([top, np.pi + top[1:-1]]), indexing="ij")
    outward = np.stack([np.zeros(X.size), np.cos(A).ravel(), np.sin(A).ravel()], axis=1)
    vertices = RADIUS_M * (outward + np.stack([X.ravel(), 0.0 * X.ravel(), 0.0 * X.ravel()], axis=1))
    index = np.arange(X.size, dtype=np.int32).reshape(X.shape)
    triangles = alternating_triangles(np.concatenate([index, index[:, :1]], axis=1))
    mesh = TriangleMesh(np.ascontiguousarray(vertices), np.ascontiguousarray(triangles))
    section = ShellSection(RADIUS_M / radius_over_thickness, YOUNG_PA, POISSON, 1000.0)
    ends = Support(np.concatenate([index[0], index[-1]]).astype(np.int32))
    model = ShellModel(mesh, section, [ends], ElementChoice("andes", bending))
    middle, watched = len(half) - 1, index[len(half) - 1 :, len(quarter) - 1]
    moved = []
    for strip in range(STRIPS):
        along = np.zeros(len(x))
        for side in (1, -1):
            knots = middle + side * np.arange(refine * strip, refine * (strip + 1) + 1)
            along[knots] += np.where(np.arange(refine + 1) % refine == 0, 0.5, 1.0)
        load = np.zeros_like(vertices)
        for turn in (0.0, np.pi):
            off = np.mod(A - turn + np.pi, 2.0 * np.pi) - np.pi
            pushes = (along[:, None] * shares(off, top, HALF_ANGLE)).ravel()[:, None] * -outward
            load += pushes / np.abs(pushes[:, 1].sum())
        moved.append(-model.solve_static(load).displacement_m[watched[: STRIPS * refine + 1 : refine], 1])
    return _stiffness(np.array(moved), 1.0)


def _stiffness(moved: FloatArray, strip_n: float) -> float:
    """Force of all strips that moves them alike, from what each moves the strips' ends by, (strips, strips + 1)."""
    between = 0.5 * (moved[:, 1:] + moved[:, :-1])
    return float(strip_n * np.linalg.solve(between.T, np.ones(STRIPS)).sum())
