"""Collision detection of a whole tick: both forceps and all particles of the catheter against a deforming duct.

    python benchmarks/bench_collision.py

A catheter of 51 particles slides 20 mm/s down a duct with r = 100 modes, touching the wall with the part that
is inside; one forceps pinches the duct near the mouth with both jaws, the other holds the catheter. The duct is
pinched by 1 mm and breathes at 3 Hz.
"""

import numpy as np
from report import Row, measure, parse, write_report

from services.mechanics.collision import CatheterContactDetector, CollisionSurface, ToolContactDetector
from services.mechanics.collision.pairs import ContactPairs
from services.mechanics.fem import ShellModel, ShellSection
from services.mechanics.fem.boundary_conditions import clamp
from services.mechanics.reduction.build import build_basis
from services.mechanics.surface.tube import DuctGeometry, parametric_duct

RADIUS_M, LENGTH_M, THICKNESS_M = 4e-3, 40e-3, 0.5e-3
CATHETER_M, MARGIN_M = 0.835e-3, 0.5e-3
N_MODES, N_PARTICLES = 100, 51
RADII_M = np.array([[2.5e-3, 1e-3, 1e-3]] * 2)
# (around, along) for about 1,440, 5,000 and 20,000 nodes; the first is the duct of the budget.
MESHES = {1440: (24, 59), 5000: (44, 113), 20000: (88, 226)}
LIMIT_S = 100e-6


class Tick:
    """One millisecond of collision detection, over and over."""

    def __init__(self, n_around: int, n_along: int) -> None:
        mesh = parametric_duct(DuctGeometry(radius_m=RADIUS_M, length_m=LENGTH_M, n_around=n_around, n_along=n_along))
        section = ShellSection(THICKNESS_M, 100e3, 0.45, 1060.0)
        basis = build_basis(ShellModel(mesh, section, supports=[clamp(mesh)]), N_MODES)
        self.surface = CollisionSurface(mesh, basis.Phi, basis.omega_rad_s, 0.5 * THICKNESS_M)
        self.tools = ToolContactDetector(self.surface, N_PARTICLES, CATHETER_M, MARGIN_M)
        self.catheter = CatheterContactDetector(self.surface, N_PARTICLES, CATHETER_M, MARGIN_M)
        self.pairs = ContactPairs.allocate(96)
        self._pinch = pinch_coordinates(mesh.vertices_m, basis.Phi, basis.omega_rad_s)
        self._count = 0
        self.q = np.empty(N_MODES)
        self.x = np.zeros((N_PARTICLES, 3))
        self.segments = np.zeros((2, 3, 2, 3))

    def move(self) -> None:
        """Put everything where it is at the next millisecond; not measured."""
        t = 1e-3 * self._count
        self._count = (self._count + 1) % 1000
        breath = 1.0 + 0.05 * np.sin(2.0 * np.pi * 3.0 * t)
        self.q[:] = breath * self._pinch
        depth = 10e-3 + 20e-3 * t
        self.x[:, 0] = LENGTH_M - depth + np.linspace(0.1, 0.0, N_PARTICLES)
        self.x[:, 1] = 0.0
        self.x[:, 2] = np.where(self.x[:, 0] < LENGTH_M, -(RADIUS_M - 0.5 * THICKNESS_M - CATHETER_M), -2.9e-3)
        wobble = 0.3e-3 * np.sin(2.0 * np.pi * 2.0 * t)
        outer = RADIUS_M + 0.5 * THICKNESS_M + RADII_M[0, 1] - 0.9e-3 * breath
        self._place(0, [30e-3 + wobble, 0.0, 6e-3], [30e-3, 0.02, 0.15], outer)
        self._place(1, [60e-3 + wobble, 0.0, 6e-3], [80e-3, -0.05, 0.15], CATHETER_M + RADII_M[1, 1])

    def _place(self, tool: int, junction: list[float], port: list[float], half_opening_m: float) -> None:
        """Jaws pointing down on either side of the y = 0 plane."""
        self.segments[tool, 0] = [port, junction]
        for jaw, sign in ((1, 1.0), (2, -1.0)):
            tip = [junction[0], sign * half_opening_m, junction[2] - 12e-3]
            self.segments[tool, jaw] = [[junction[0], sign * half_opening_m * 0.9, junction[2]], tip]

    def detect(self) -> None:
        self.pairs.clear()
        self.surface.update(self.q)
        self.tools.detect(self.segments, RADII_M, self.x, self.pairs)
        self.catheter.detect(self.x, self.pairs)


def pinch_coordinates(vertices: np.ndarray, Phi: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """Static modal coordinates of two opposite forces at x = 30 mm that close the duct by 1 mm a side."""
    q = np.zeros(len(omega))
    for sign in (1.0, -1.0):
        node = np.argmin(np.linalg.norm(vertices - [30e-3, sign * RADIUS_M, 0.0], axis=1))
        q -= sign * Phi[node, 1] / omega**2
    return q * 1e-3 / np.abs(Phi @ q).max()


def per_tick(tick: Tick, n: int = 1000) -> dict[str, float]:
    """Mean work of a tick in the surface's own counts."""
    before, pairs = tick.surface.cost, 0
    for _ in range(n):
        tick.move()
        tick.detect()
        pairs += tick.pairs.count
    after = tick.surface.cost
    names = ("triangle_tests", "tree_visits", "nodes_placed", "searches")
    return {"pairs": pairs / n, **{k: (getattr(after, k) - getattr(before, k)) / n for k in names}}


def rows_of(tick: Tick, limit_s: float | None, samples: int) -> list[Row]:
    """Time one duct by itself, as in the rig: another one's modes would only push it out of the cache."""

    def whole() -> None:
        tick.move()
        tick.detect()

    timing = measure({"whole": whole, "move": tick.move}, samples=samples)
    move_s = timing["move"].median_s
    note = ", ".join(f"{value:.0f} {name.replace('_', ' ')}" for name, value in per_tick(tick).items())
    name = f"moving the scene and detecting, {tick.surface.mesh.n_vertices:,} nodes"
    limit = None if limit_s is None else limit_s + move_s
    return [
        Row.from_timing(name, timing["whole"], limit, note),
        Row.from_timing("of which moving the scene, in numpy", timing["move"]),
    ]


def main() -> None:
    arguments = parse(__doc__, samples=(5000, "ticks of each mesh"))
    rows = []
    for n, shape in MESHES.items():
        rows += rows_of(Tick(*shape), LIMIT_S if n == min(MESHES) else None, arguments.samples)
    write_report(
        "collision",
        "Collision detection: both forceps and 51 particles against a duct with r = 100",
        rows,
        notes="The budget of 100 us is for the detection; the scene's own motion is measured with it and added.",
    )


if __name__ == "__main__":
    main()
