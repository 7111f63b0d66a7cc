"""Classical buckling problems as shell models: each function returns a load over the one that theory gives.

Lengths, forces and moduli have no unit: any consistent set gives the same answer.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.fem import (
    ElementChoice,
    ShellModel,
    ShellSection,
    Support,
    clamp,
    pressure_load,
)
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct
from trocar.studies.fem.buckling import compute_buckling
from trocar.studies.published.shells import PLATE_SECTION, UNIT_DENSITY, mapped_patch, plate_rigidity

PlateLoad = Literal["one way", "both ways", "shear"]
PLATE_COEFFICIENT: dict[tuple[PlateLoad, bool], float] = {
    ("one way", False): 4.0,
    ("both ways", False): 2.0,
    ("one way", True): 10.07,
    ("shear", False): 9.325,
}
"""N b² / (pi² D) of the square plate, simply supported or (True) clamped all round: exact for the first two; Levy 1942,
and Stein and Neff 1947, for the others (unverified)."""


def plate_buckling(n: int, load: PlateLoad, is_clamped: bool, elements: ElementChoice, count: int = 1) -> FloatArray:
    """``count`` lowest coefficients N b² / (pi² D) of a square plate whose edges may move in its plane."""
    patch = mapped_patch(n, n, lambda s, t: (s, t, np.zeros_like(s)))
    grid = patch.grid
    first, last, low, high = grid[0], grid[-1], grid[:, 0], grid[:, -1]
    ends, sides = np.concatenate([first, last]), np.concatenate([low, high])
    across = (
        [Support(np.concatenate([ends, sides]), ("uz", "rx", "ry"))]
        if is_clamped
        else [Support(ends, ("uz", "rx")), Support(sides, ("uz", "ry"))]
    )
    in_plane = [Support(first[:1], ("ux", "uy")), Support(last[:1], ("uy",))]
    pushes = {
        "one way": ((last, (-1, 0)), (first, (1, 0))),
        "both ways": ((last, (-1, 0)), (first, (1, 0)), (high, (0, -1)), (low, (0, 1))),
        "shear": ((last, (0, 1)), (first, (0, -1)), (high, (1, 0)), (low, (-1, 0))),
    }
    force = np.zeros((patch.mesh.n_vertices, 3))
    for edge, direction in pushes[load]:
        force[edge, :2] += _shares(len(edge))[:, None] * np.array(direction)
    model = ShellModel(patch.mesh, PLATE_SECTION, [*across, *in_plane], elements)
    return _factors(model, force, count) / (np.pi**2 * plate_rigidity())


def _shares(n: int) -> FloatArray:
    """(n,) parts of a unit force spread over an evenly divided edge."""
    shares = np.ones(n)
    shares[[0, -1]] = 0.5
    shares /= shares.sum()
    return shares


def column_buckling(n_around: int, n_along: int, elements: ElementChoice) -> float:
    """Tip load of a clamped tube 40 radii long over Euler's with Engesser's shear (coefficient 1/2)."""
    E, nu, radius, length, h = 1e5, 0.3, 4e-3, 160e-3, 0.4e-3
    mesh = parametric_duct(DuctGeometry(radius, length, n_around, n_along))
    model = ShellModel(mesh, ShellSection(h, E, nu, UNIT_DENSITY), [clamp(mesh)], elements)
    euler = np.pi**2 * E * np.pi * radius**3 * h * (1.0 + 0.25 * (h / radius) ** 2) / (4.0 * length**2)
    shear = 0.5 * E / (2.0 * (1.0 + nu)) * 2.0 * np.pi * radius * h
    return float(_factors(model, _push_on_mouth(mesh), 1)[0] / (euler / (1.0 + euler / shear)))


def cylinder_buckling(n_around: int, n_along: int, elements: ElementChoice) -> float:
    """Axial load of a cylinder of R/h 25, as long as its radius, over the classical E h² / (R sqrt(3)) per length.

    Poisson's ratio is zero, so that the state before buckling is the membrane's alone. The classical value holds to
    terms of order h / R.
    """
    E, radius, h = 1e5, 10e-3, 0.4e-3
    mesh = parametric_duct(DuctGeometry(radius, radius, n_around, n_along))
    supports = [
        Support(mesh.vertex_sets["clamped"], ("ux", "uy", "uz")),
        Support(mesh.vertex_sets["mouth"], ("uy", "uz")),
    ]
    model = ShellModel(mesh, ShellSection(h, E, 0.0, UNIT_DENSITY), supports, elements)
    per_length = _factors(model, _push_on_mouth(mesh), 1)[0] / (2.0 * np.pi * radius)
    return float(per_length / (E * h**2 / (radius * 3.0**0.5)))


def ring_buckling(n_around: int, elements: ElementChoice, count: int = 4) -> FloatArray:
    """Pressures outside a free ring over Bresse's 3 E I / R³: 1 for two waves, 8/3 for three, each twice.

    Needs the pressure to stay normal to the wall: one that keeps its direction gives other values.
    """
    E, radius, h = 1e5, 10e-3, 0.4e-3
    mesh = parametric_duct(DuctGeometry(radius, radius, n_around, n_around // 3))
    rim = mesh.vertex_sets["clamped"]
    y, z = mesh.vertices_m[rim, 1], mesh.vertices_m[rim, 2]
    top, bottom, side = rim[np.argmax(y)], rim[np.argmin(y)], rim[np.argmax(z)]
    supports = [_hold("ux", top, bottom, side), _hold("uz", top, bottom), _hold("uy", side)]
    model = ShellModel(mesh, ShellSection(h, E, 0.0, UNIT_DENSITY), supports, elements)
    solution = model.solve_static(pressure_load(mesh, -1.0))
    return compute_buckling(model, solution, count, -1.0).load_factor / (0.25 * E * (h / radius) ** 3)


def _hold(dof: str, *vertices: int) -> Support:
    return Support(np.array(vertices, np.int32), (dof,))


def _push_on_mouth(mesh: TriangleMesh) -> FloatArray:
    rim: IntArray = mesh.vertex_sets["mouth"]
    force = np.zeros((mesh.n_vertices, 3))
    force[rim, 0] = -1.0 / len(rim)
    return force


def _factors(model: ShellModel, force: FloatArray, count: int) -> FloatArray:
    return compute_buckling(model, model.solve_static(force), count).load_factor
