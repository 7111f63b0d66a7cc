"""Shells of the literature on large displacements, on grids of any fineness, and the duct that a forceps squeezes.

K. Y. Sze, X. H. Liu and S. H. Lo, Finite Elements in Analysis and Design 40:1551 (2004), unless said otherwise. Units
are theirs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.fem import ElementChoice, ShellModel, ShellSection, Support, clamp
from trocar.services.mechanics.fem.nonlinear import CorotationalShell, NonlinearLoad, PathPoint
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct


def _pairs(text: str) -> FloatArray:
    return np.array(text.split(), np.float64).reshape(-1, 2)


SHEAR = {0.25: (3.015, 0.563), 0.5: (4.933, 1.604), 0.75: (6.031, 2.541), 1.0: (6.698, 3.286)}
"""Cantilever under shear: deflection and shortening of the tip by part of the load."""
SLIT_PLATE = {0.25: (10.288, 7.602), 0.5: (13.768, 10.468), 0.75: (15.842, 12.31), 1.0: (17.528, 13.891)}
"""Slit annular plate: lift of the outer and the inner corner."""
HEMISPHERE = (4.067, 8.178)
"""Pinched hemisphere at its full load: outward at the pull, inward at the push (unverified: from memory)."""
PINCH = {0.2: 0.876, 0.5: 0.746, 1.0: 0.642}
"""CalculiX, S8R with large displacements: force over the linear force at 10, 25, 50 % closure of the duct's mouth."""

PULLED = {0.25: (2.180, 3.087, 3.310), 1.0: (2.768, 4.551, 3.269)}
"""Cylinder pulled apart, by part of its load: outward at the force, inward beside it in the middle and at its end.

Of Sze, Liu and Lo, as the regression tests of MBDyn hold their table."""

HALF_CYLINDER = {0.05: 5.421, 0.2: 37.582, 0.5: 132.653, 1.0: 171.505}
"""Half cylinder pushed at its free end: how far the force has moved, by part of its load (their table, as
M. Neunteufel's collection of shells for NGSolve holds it)."""

DIAPHRAGMS = {0.05: (9.561, -0.233), 0.1: (23.164, -2.391), 1.0: (83.102, 34.272)}
"""Cylinder pinched between rigid diaphragms, by part of its load: inward at the force, outward a quarter round beside
it (of the same tables as `PULLED`)."""

ROOF_LIMITS = {12.7: (0.7421, 11.293), 6.35: (0.1953, 12.892)}
"""Hinged roof, by thickness: part of the load at which it first snaps, and how far its middle has sunk by then (of
their tables, as S. G. P. Castro's studies of curved panels hold them)."""

ROOF_PATHS = {
    12.7: _pairs(
        "0 0  0.0877 0.693  0.198 1.638  0.3473 3.087  0.4686 4.477  0.5647 5.802  0.6381 7.057  0.6908 8.237  "
        "0.7246 9.339  0.7412 10.358  0.7421 11.293  0.7286 12.141  0.7023 12.903  0.6649 13.583  0.6182 14.188  "
        "0.5643 14.728  0.5055 15.217  0.4442 15.676  0.383 16.125  0.3245 16.59  0.2717 17.094  0.2272 17.657  "
        "0.194 18.299  0.175 19.028  0.1729 19.852  0.1905 20.771  0.2303 21.78  0.295 22.875  0.3871 24.049  "
        "0.4443 24.663  0.5093 25.293  0.5826 25.94  0.6644 26.601  0.7551 27.276  0.8549 27.964  0.9643 28.663"
    ),
    6.35: _pairs(
        "0 0  0.0517 1.846  0.1182 5.271  0.1583 8.257  0.1837 10.799  0.1914 11.904  0.1953 12.892  0.195 13.752  "
        "0.1901 14.472  0.1806 15.05  0.1671 15.501  0.1323 16.145  0.0923 16.602  0.0504 16.915  0.0083 17.008  "
        "-0.0312 16.697  -0.0622 15.78  -0.0739 15.206  -0.0861 14.767  -0.1001 14.52  -0.1142 14.451  "
        "-0.1247 14.862  -0.1288 15.778  -0.1271 16.961  -0.1196 18.32  -0.1055 19.817  -0.0825 21.42  -0.0484 23.1  "
        "-0.0006 24.824  0.0626 26.565  0.1427 28.302  0.2403 30.023  0.3559 31.72  0.4898 33.388  0.6417 35.024  "
        "0.8114 36.626"
    ),
}
"""Hinged roof, by thickness: the whole path as parts of the load and how far the middle has sunk, over limit points and
where it turns back (of the same tables as `PULLED`)."""

Placing = Callable[[FloatArray, FloatArray], Sequence[FloatArray]]


@dataclass(frozen=True)
class Problem:
    """A shell, its full load, and the vertices whose motion is asked for."""

    shell: CorotationalShell
    load: NonlinearLoad
    watched: IntArray

    def moved(self, point: PathPoint) -> FloatArray:
        """(k, 3) displacements of the watched vertices."""
        mesh = self.shell.model.mesh
        displacement: FloatArray = (point.at.position_m - mesh.vertices_m)[self.watched]
        return displacement


def grid(place: Placing, n_u: int, n_v: int) -> tuple[TriangleMesh, IntArray]:
    """Triangles over the unit square mapped by ``place``, diagonals in turn, and the (n_u + 1, n_v + 1) vertices."""
    u, v = np.meshgrid(np.linspace(0, 1, n_u + 1), np.linspace(0, 1, n_v + 1), indexing="ij")
    vertices = np.stack(np.broadcast_arrays(*place(u.ravel(), v.ravel())), axis=1)
    index = np.arange(u.size, dtype=np.int32).reshape(u.shape)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    turned = (np.add.outer(np.arange(n_u), np.arange(n_v)) % 2 == 1)[..., None]
    first = np.where(turned, np.stack([a, b, d], -1), np.stack([a, b, c], -1))
    second = np.where(turned, np.stack([b, c, d], -1), np.stack([a, c, d], -1))
    triangles = np.concatenate([first.reshape(-1, 3), second.reshape(-1, 3)])
    return TriangleMesh(np.ascontiguousarray(vertices, np.float64), np.ascontiguousarray(triangles)), index


def cantilever(load: str, n_along: int = 16, membrane: str = "cst") -> Problem:
    """L 10, W 1, t 0.1, E 1.2e6, nu 0; ``shear`` of 4 at its end, or the ``moment`` that closes it to a circle."""
    mesh, index = grid(lambda u, v: (10.0 * u, v, 0.0 * u), n_along, 2)
    dead = np.zeros((mesh.n_vertices, 6))
    if load == "shear":
        dead[index[-1], 2] = 4.0 * along_edge(3)
    else:
        dead[index[-1], 4] = -2.0 * np.pi * 100.0 / 10.0 * along_edge(3)
    shell = _shell(mesh, 0.1, 1.2e6, 0.0, [Support(index[0])], membrane)
    return Problem(shell, _dead(dead), index[[-1, n_along // 2], 1])


def slit_plate(n_around: int, n_across: int, membrane: str = "andes") -> Problem:
    """An annular plate 6 to 10, t 0.03, E 2.1e7, nu 0, one side of its slit clamped, the other lifted by 3.2."""
    mesh, index = grid(
        lambda u, v: (
            (6.0 + 4.0 * v) * np.cos(2.0 * np.pi * u),
            (6.0 + 4.0 * v) * np.sin(2.0 * np.pi * u),
            0.0 * u,
        ),
        n_around,
        n_across,
    )
    dead = np.zeros((mesh.n_vertices, 6))
    dead[index[-1], 2] = 3.2 * along_edge(n_across + 1)
    shell = _shell(mesh, 0.03, 2.1e7, 0.0, [Support(index[0])], membrane)
    return Problem(shell, _dead(dead), index[-1, [-1, 0]])


def hemisphere(n: int, membrane: str = "andes") -> Problem:
    """A quarter of the hemisphere R 10, t 0.04, E 6.825e7, nu 0.3, its hole of 18 degrees; pulled and pushed by 400."""

    def place(u: FloatArray, v: FloatArray) -> Sequence[FloatArray]:
        around, up = 0.5 * np.pi * u, np.radians(72.0) * v
        return 10.0 * np.cos(up) * np.cos(around), 10.0 * np.cos(up) * np.sin(around), 10.0 * np.sin(up)

    mesh, index = grid(place, n, n)
    supports = [
        Support(index[0], ("uy", "rx", "rz")),
        Support(index[-1], ("ux", "ry", "rz")),
        Support(index[0, :1], ("uz",)),
    ]
    dead = np.zeros((mesh.n_vertices, 6))
    dead[index[0, 0], 0], dead[index[-1, 0], 1] = 200.0, -200.0
    return Problem(_shell(mesh, 0.04, 6.825e7, 0.3, supports, membrane), _dead(dead), index[[0, -1], 0])


def closed_hemisphere(n: int, membrane: str = "andes") -> Problem:
    """The same without its hole: three patches of n x n meet between its pole and the two forces."""
    mesh = _octant(n)
    x, y, z = mesh.vertices_m.T
    pulled, pushed, pole = (np.flatnonzero(along > 10.0 - 1e-9).astype(np.int32) for along in (x, y, z))
    supports = [
        Support(np.flatnonzero(y < 1e-9).astype(np.int32), ("uy", "rx", "rz")),
        Support(np.flatnonzero(x < 1e-9).astype(np.int32), ("ux", "ry", "rz")),
        Support(pole, ("uz",)),
    ]
    dead = np.zeros((mesh.n_vertices, 6))
    dead[pulled, 0], dead[pushed, 1] = 200.0, -200.0
    watched = np.concatenate([pulled, pushed])
    return Problem(_shell(mesh, 0.04, 6.825e7, 0.3, supports, membrane), _dead(dead), watched)


def _octant(n: int) -> TriangleMesh:
    """An eighth of a sphere of radius 10 out of three faces of a cube, drawn onto it."""

    def face(first: int) -> Placing:
        def place(u: FloatArray, v: FloatArray) -> Sequence[FloatArray]:
            cube = np.roll([np.ones_like(u), np.tan(0.25 * np.pi * u), np.tan(0.25 * np.pi * v)], first, axis=0)
            return list(10.0 * cube / np.linalg.norm(cube, axis=0))

        return place

    faces = [grid(face(first), n, n)[0] for first in range(3)]
    every = np.concatenate([face.vertices_m for face in faces])
    _, kept, name = np.unique(np.round(every, 9), axis=0, return_index=True, return_inverse=True)
    triangles = np.concatenate([face.triangles + k * len(faces[0].vertices_m) for k, face in enumerate(faces)])
    return TriangleMesh(every[kept], np.ascontiguousarray(name.ravel()[triangles], np.int32))


def pulled_cylinder(n_around: int, n_along: int, membrane: str = "andes") -> Problem:
    """An eighth of the open cylinder R 4.953, L 10.35, t 0.094, E 10.5e6, nu 0.3125, pulled apart by 40,000.

    Watched are the point of the force, that a quarter round beside it, and that at the open end.
    """
    mesh, index = grid(
        lambda u, v: (4.953 * np.sin(0.5 * np.pi * u), 0.5 * 10.35 * v, 4.953 * np.cos(0.5 * np.pi * u)),
        n_around,
        n_along,
    )
    supports = [
        Support(index[0], ("ux", "ry", "rz")),
        Support(index[-1], ("uz", "rx", "ry")),
        Support(index[:, 0], ("uy", "rx", "rz")),
    ]
    dead = np.zeros((mesh.n_vertices, 6))
    dead[index[0, 0], 2] = 40e3 / 4.0
    watched = np.array([index[0, 0], index[-1, 0], index[-1, -1]])
    return Problem(_shell(mesh, 0.094, 10.5e6, 0.3125, supports, membrane), _dead(dead), watched)


def pushed_half_cylinder(n_around: int, n_along: int, membrane: str = "andes") -> Problem:
    """Half of the half cylinder R 101.6, L 304.8, t 3, E 2068.5, nu 0.3, pushed by 2000 at its free end.

    The other end is clamped, the straight edges are planes of symmetry: two such forces press the whole cylinder.
    """
    mesh, index = grid(
        lambda u, v: (101.6 * np.sin(0.5 * np.pi * u), 304.8 * v, 101.6 * np.cos(0.5 * np.pi * u)), n_around, n_along
    )
    supports = [
        Support(index[:, -1]),
        Support(index[0, :-1], ("ux", "ry", "rz")),
        Support(index[-1, :-1], ("uz", "rx", "ry")),
    ]
    dead = np.zeros((mesh.n_vertices, 6))
    dead[index[0, 0], 2] = -2000.0 / 2.0
    return Problem(_shell(mesh, 3.0, 2068.5, 0.3, supports, membrane), _dead(dead), index[:1, 0])


def cylinder_between_diaphragms(n_around: int, n_along: int, membrane: str = "andes") -> Problem:
    """An eighth of the cylinder R 100, L 200, t 1, E 30e3, nu 0.3, pinched by 12,000; its ends keep their circle.

    Watched are the point of the force and that a quarter round beside it.
    """
    mesh, index = grid(
        lambda u, v: (100.0 * np.sin(0.5 * np.pi * u), 100.0 * v, 100.0 * np.cos(0.5 * np.pi * u)), n_around, n_along
    )
    supports = [
        Support(index[0], ("ux", "ry", "rz")),
        Support(index[-1], ("uz", "rx", "ry")),
        Support(index[:, 0], ("uy", "rx", "rz")),
        Support(index[:, -1], ("ux", "uz")),
    ]
    dead = np.zeros((mesh.n_vertices, 6))
    dead[index[0, 0], 2] = -12e3 / 4.0
    return Problem(_shell(mesh, 1.0, 30e3, 0.3, supports, membrane), _dead(dead), index[[0, -1], 0])


def hinged_roof(thickness: float, n: int = 8) -> Problem:
    """A quarter of the cylindrical roof R 2540, L 508, theta 0.1, E 3102.75, nu 0.3, pushed by 3000 in its middle."""
    mesh, index = grid(lambda u, v: (2540.0 * np.sin(0.1 * u), 254.0 * v, 2540.0 * (np.cos(0.1 * u) - 1.0)), n, n)
    supports = [
        Support(index[-1], ("ux", "uy", "uz")),
        Support(index[0], ("ux", "ry", "rz")),
        Support(index[:, 0], ("uy", "rx", "rz")),
    ]
    dead = np.zeros((mesh.n_vertices, 6))
    dead[index[0, 0], 2] = -3000.0 / 4.0
    return Problem(_shell(mesh, thickness, 3102.75, 0.3, supports, "andes"), _dead(dead), index[:1, 0])


def squeezed_duct(n_around: int = 24, n_along: int = 36) -> Problem:
    """The reference duct, jaws 4 mm wide on its mouth that close it by half; watched are the vertices of one jaw."""
    geometry = DuctGeometry(radius_m=0.004, length_m=0.04, n_around=n_around, n_along=n_along, wall_thickness_m=0.5e-3)
    mesh = parametric_duct(geometry)
    x, y, z = mesh.vertices_m.T
    jaws = [np.flatnonzero((x > 0.0359) & (side * y > 0.0039) & (abs(z) < 1e-6)) for side in (1.0, -1.0)]
    supports = [clamp(mesh), *(Support(jaw.astype(np.int32), ("uy",)) for jaw in jaws)]
    model = ShellModel(mesh, ShellSection(0.5e-3, 1e5, 0.45, 1060.0), supports, ElementChoice("andes", "dkt"))
    imposed = np.zeros((mesh.n_vertices, 6))
    imposed[jaws[0], 1], imposed[jaws[1], 1] = -0.002, 0.002
    load = NonlinearLoad(np.zeros_like(imposed), 0.0, imposed)
    return Problem(CorotationalShell(model), load, jaws[1].astype(np.int32))


def off_the_path(points: FloatArray, path: FloatArray) -> FloatArray:
    """(k,) how far points (k, 2) are from a path (n, 2), each of the two over the largest of the points."""
    scale = np.abs(points).max(axis=0)
    start, way = path[:-1] / scale, np.diff(path, axis=0) / scale
    to = (points / scale)[:, None] - start
    along = np.clip(np.sum(to * way, axis=2) / np.sum(way * way, axis=1), 0.0, 1.0)
    off: FloatArray = np.linalg.norm(to - along[:, :, None] * way, axis=2).min(axis=1)
    return off


def force_over_linear(problem: Problem, path: Sequence[PathPoint]) -> dict[float, float]:
    """By part of the closure, the force on the watched jaw over that of the linear shell."""
    load, jaw = problem.load, problem.watched
    linear = problem.shell.model.solve_static(load.dead, load.imposed).reaction[jaw, 1].sum()
    return {round(point.part, 6): float(point.reaction[jaw, 1].sum() / (point.part * linear)) for point in path}


def along_edge(n: int) -> FloatArray:
    """(n,) shares of a line load among equally spaced vertices."""
    weights = np.ones(n)
    weights[[0, -1]] = 0.5
    shares: FloatArray = weights / weights.sum()
    return shares


def _shell(
    mesh: TriangleMesh, thickness: float, modulus: float, poisson: float, supports: Sequence[Support], membrane: str
) -> CorotationalShell:
    section = ShellSection(thickness, modulus, poisson, 1.0)
    return CorotationalShell(ShellModel(mesh, section, supports, ElementChoice(membrane, "dkt")))


def _dead(dead: FloatArray) -> NonlinearLoad:
    return NonlinearLoad(dead, 0.0, np.zeros_like(dead))
