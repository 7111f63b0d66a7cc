"""A tube pressed by two jaws, as a solid in CalculiX (C3D20R) and as a shell: what thickness does to a pinch.

Both ends are clamped; the jaws press evenly, along the normal, on patches opposite each other in the middle. An octant
of the solid is meshed, finer towards the jaw.
"""

from __future__ import annotations

import itertools
import re
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.fem import ElementChoice, ShellModel, ShellSection, Support
from trocar.services.mechanics.surface.mesh import TriangleMesh

RADIUS_M, YOUNG_PA, POISSON = 0.004, 1e5, 0.45
HALF_LENGTH = 2.0
"""In radii."""
_DECK = """*NODE, NSET=ALL
{nodes}
*ELEMENT, TYPE=C3D20R, ELSET=WALL
{elements}
*ELSET, ELSET=PRESSED
{pressed}
*NSET, NSET=MIDDLE
{middle}
*NSET, NSET=END
{end}
*NSET, NSET=SIDE
{side}
*NSET, NSET=TOP
{top}
*NSET, NSET=WATCHED
{watched}
*MATERIAL, NAME=WALL
*ELASTIC
{young}, {poisson}
*SOLID SECTION, ELSET=WALL, MATERIAL=WALL
*BOUNDARY
MIDDLE, 1, 1
SIDE, 2, 2
TOP, 3, 3
END, 1, 3
*STEP
*STATIC
*DLOAD
PRESSED, P2, {pressure}
*NODE PRINT, NSET=WATCHED
U
*END STEP
"""


@dataclass(frozen=True)
class Pinch:
    """Radius over thickness, and half the jaws' width, along and round, over the radius."""

    radius_over_thickness: float
    jaw: float

    @property
    def thickness_m(self) -> float:
        return RADIUS_M / self.radius_over_thickness


def graded(first: float, last: float, inside: int, outside: int) -> FloatArray:
    """0 to ``last`` with a knot at ``first``: even below it, growing in proportion above."""
    ratio = (last / first) ** (1.0 / outside)
    return np.concatenate([np.linspace(0.0, first, inside + 1), first * ratio ** np.arange(1, outside + 1)])


def solid_deflection(pinch: Pinch, force_n: float, folder: Path, n: int = 2) -> float:
    """How far (m) the middle of the wall gives way under the middle of a jaw that presses with ``force_n``.

    Raises
    ------
    RuntimeError
        CalculiX told no displacement.
    """
    # From the jaw's middle: along the axis, and round from the top; half steps are the nodes between the corners.
    x, angle = (with_middles(graded(pinch.jaw, end, 2 * n, 5 * n)) for end in (HALF_LENGTH, np.pi / 2))
    t = pinch.thickness_m
    radius = np.linspace(RADIUS_M - t / 2, RADIUS_M + t / 2, 4 * n + 1)
    shape = len(x), len(angle), len(radius)
    number = {
        at: k + 1
        for k, at in enumerate(at for at in itertools.product(*map(range, shape)) if sum(i % 2 for i in at) <= 1)
    }
    cells = list(itertools.product(*(range(0, size - 1, 2) for size in shape)))
    pressed = [k + 1 for k, (i, j, r) in enumerate(cells) if i < 4 * n and j < 4 * n and r == shape[2] - 3]
    outer = RADIUS_M + t / 2
    pressure = force_n / (2.0 * pinch.jaw * RADIUS_M * 2.0 * outer * np.sin(pinch.jaw))
    sets = {
        "middle": [n for (i, _, _), n in number.items() if i == 0],
        "end": [n for (i, _, _), n in number.items() if i == shape[0] - 1],
        "top": [n for (_, j, _), n in number.items() if j == 0],
        "side": [n for (_, j, _), n in number.items() if j == shape[1] - 1],
        "watched": [number[0, 0, 2 * n]],
        "pressed": pressed,
    }
    places = [
        f"{k}, {RADIUS_M * x[i]:.9e}, {radius[r] * np.cos(angle[j]):.9e}, {radius[r] * np.sin(angle[j]):.9e}"
        for (i, j, r), k in number.items()
    ]
    deck = _DECK.format(
        nodes="\n".join(places),
        elements="\n".join(element(k + 1, cell, number) for k, cell in enumerate(cells)),
        young=YOUNG_PA,
        poisson=POISSON,
        pressure=pressure,
        **{name: "\n".join(map(str, members)) for name, members in sets.items()},
    )
    (folder / "pinch.inp").write_text(deck, encoding="ascii")
    said = subprocess.run(["ccx", "pinch"], cwd=folder, capture_output=True, text=True, timeout=300, check=False)
    rows = re.findall(r"^\s+\d+\s+\S+\s+(\S+)\s+\S+\s*$", (folder / "pinch.dat").read_text(), re.MULTILINE)
    if not rows:
        raise RuntimeError(f"ccx told no displacement: {said.stdout[-300:]}")
    return abs(float(rows[-1]))


def with_middles(knots: FloatArray) -> FloatArray:
    return np.sort(np.concatenate([knots, 0.5 * (knots[1:] + knots[:-1])]))


#: Corners of a brick, its lower edges, its upper ones and its upright ones, in CalculiX' order: (x, angle, radius).
_BRICK = (
    *((0, 0, 0), (0, 2, 0), (2, 2, 0), (2, 0, 0), (0, 0, 2), (0, 2, 2), (2, 2, 2), (2, 0, 2)),
    *((0, 1, 0), (1, 2, 0), (2, 1, 0), (1, 0, 0), (0, 1, 2), (1, 2, 2), (2, 1, 2), (1, 0, 2)),
    *((0, 0, 1), (0, 2, 1), (2, 2, 1), (2, 0, 1)),
)


def element(k: int, cell: tuple[int, ...], number: dict[tuple[int, ...], int]) -> str:
    i, j, r = cell
    nodes = [str(number[i + a, j + b, r + c]) for a, b, c in _BRICK]
    return f"{k}, " + ", ".join(nodes[:15]) + ",\n" + ", ".join(nodes[15:])


def shell_deflection(pinch: Pinch, force_n: float, bending: str, n: int = 8) -> float:
    """The same of a shell of triangles, whole, on knots like the solid's."""
    half = graded(pinch.jaw, HALF_LENGTH, n, 3 * n)
    x = np.concatenate([-half[:0:-1], half])
    quarter = graded(pinch.jaw, np.pi / 2, n, 3 * n)
    top = np.concatenate([-quarter[:0:-1], quarter])
    angle = np.concatenate([top, np.pi + top[1:-1]])
    X, A = np.meshgrid(x, angle, indexing="ij")
    vertices = RADIUS_M * np.stack([X.ravel(), np.cos(A).ravel(), np.sin(A).ravel()], axis=1)
    index = np.arange(X.size, dtype=np.int32).reshape(X.shape)
    a, b = index[:-1], index[1:]
    c, d = np.roll(b, -1, axis=1), np.roll(a, -1, axis=1)
    turned = (np.add.outer(np.arange(a.shape[0]), np.arange(a.shape[1])) % 2 == 1)[..., None]
    first = np.where(turned, np.stack([a, b, d], -1), np.stack([a, b, c], -1))
    second = np.where(turned, np.stack([b, c, d], -1), np.stack([a, c, d], -1))
    triangles = np.concatenate([first.reshape(-1, 3), second.reshape(-1, 3)])
    mesh = TriangleMesh(np.ascontiguousarray(vertices), np.ascontiguousarray(triangles))
    ends = np.concatenate([index[0], index[-1]]).astype(np.int32)
    section = ShellSection(pinch.thickness_m, YOUNG_PA, POISSON, 1000.0)
    model = ShellModel(mesh, section, [Support(ends)], ElementChoice("andes", bending))
    load = np.zeros((mesh.n_vertices, 3))
    for turn in (0.0, np.pi):
        off = np.mod(A - turn + np.pi, 2.0 * np.pi) - np.pi
        share = shares(X, x, pinch.jaw) * shares(off, top, pinch.jaw)
        normal = np.stack([np.zeros(X.size), np.cos(A).ravel(), np.sin(A).ravel()], axis=1)
        pushes = share.ravel()[:, None] * -normal
        load += force_n * pushes / abs(pushes[:, 1].sum())
    return abs(float(model.solve_static(load).displacement_m[index[len(half) - 1, len(quarter) - 1], 1]))


def shares(at: FloatArray, knots: FloatArray, jaw: float) -> FloatArray:
    """Length of the jaw that each knot carries."""
    inside = knots[np.abs(knots) <= jaw + 1e-9]
    step = inside[1] - inside[0]
    weight = np.where(np.abs(at) < jaw - 1e-9, step, np.where(np.abs(at) < jaw + 1e-9, 0.5 * step, 0.0))
    return np.asarray(weight)
