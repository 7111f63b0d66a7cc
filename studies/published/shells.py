"""The published shell problems as models: statics of plates and shells, natural frequencies, the reference duct.

Every function builds one problem at a mesh density and returns the number that is published for it. Lengths, forces and
moduli of the classical problems have no unit: any consistent set gives the same answer.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.fem import (
    ElementChoice,
    ShellModel,
    ShellSection,
    Support,
    clamp,
    compute_modes,
)
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.services.mechanics.surface.tube import DuctGeometry, alternating_triangles, parametric_duct
from trocar.studies.fem.loads import surface_load

UNIT_DENSITY = 1.0


@dataclass(frozen=True)
class PatchCase:
    """A mapped rectangle: mesh plus its vertex indices as a grid."""

    mesh: TriangleMesh
    grid: IntArray
    """(rows, columns) vertex indices; rows along the first parameter."""


def mapped_patch(
    n_first: int, n_second: int, position: Callable[[FloatArray, FloatArray], tuple[FloatArray, ...]]
) -> PatchCase:
    """Mesh the unit square mapped by ``position(s, t) -> (x, y, z)``, diagonals alternating.

    Normals point along d/dt x d/ds.
    """
    s, t = np.meshgrid(np.linspace(0, 1, n_first + 1), np.linspace(0, 1, n_second + 1), indexing="ij")
    xyz = np.stack([np.broadcast_to(c, s.shape) for c in position(s, t)], axis=-1).reshape(-1, 3)
    grid = np.arange(len(xyz), dtype=np.int32).reshape(s.shape)
    return PatchCase(TriangleMesh(xyz, alternating_triangles(grid)), grid)


def scordelis_lo(n: int, elements: ElementChoice) -> float:
    """Sag of the free edge at mid-span of the Scordelis-Lo roof; n elements a side of a quarter. Published 0.3024."""
    radius, half_length, half_angle = 25.0, 25.0, np.radians(40.0)
    patch = mapped_patch(
        n,
        n,
        lambda s, t: (half_length * s, radius * np.sin(half_angle * t), radius * np.cos(half_angle * t)),
    )
    grid = patch.grid
    supports = [
        Support(grid[0], ("uy", "uz")),
        Support(grid[-1], ("ux", "ry", "rz")),
        Support(grid[:, 0], ("uy", "rx", "rz")),
    ]
    model = ShellModel(patch.mesh, ShellSection(0.25, 4.32e8, 0.0, UNIT_DENSITY), supports, elements)
    load = surface_load(patch.mesh, np.array([0.0, 0.0, -90.0]))
    return -float(model.solve_static(load).displacement_m[grid[-1, -1], 2])


def pinched_cylinder(n: int, elements: ElementChoice) -> float:
    """Deflection under a unit pinch of a cylinder on end diaphragms. Published 1.8248e-5.

    ``n`` elements a side of an octant.
    """
    patch = mapped_patch(
        n,
        n,
        lambda s, t: (300.0 * s, 300.0 * np.sin(0.5 * np.pi * t), 300.0 * np.cos(0.5 * np.pi * t)),
    )
    grid = patch.grid
    supports = [
        Support(grid[0], ("uy", "uz")),
        Support(grid[-1], ("ux", "ry", "rz")),
        Support(grid[:, 0], ("uy", "rx", "rz")),
        Support(grid[:, -1], ("uz", "rx", "ry")),
    ]
    model = ShellModel(patch.mesh, ShellSection(3.0, 3e6, 0.3, UNIT_DENSITY), supports, elements)
    load = np.zeros((patch.mesh.n_vertices, 3))
    load[grid[-1, 0], 2] = -0.25
    return -float(model.solve_static(load).displacement_m[grid[-1, 0], 2])


PLATE_SECTION = ShellSection(0.01, 1e7, 0.3, UNIT_DENSITY)


def plate_model(n: int, is_clamped: bool, elements: ElementChoice) -> tuple[ShellModel, PatchCase]:
    """Unit square plate in the xy plane, all edges clamped or simply supported (deflection and edge slope held)."""
    patch = mapped_patch(n, n, lambda s, t: (s, t, np.zeros_like(s)))
    grid = patch.grid
    in_plane = Support(grid.ravel(), ("ux", "uy", "rz"))
    ends, sides = np.concatenate([grid[0], grid[-1]]), np.concatenate([grid[:, 0], grid[:, -1]])
    edges = (
        [Support(np.concatenate([ends, sides]), ("uz", "rx", "ry"))]
        if is_clamped
        else [Support(ends, ("uz", "rx")), Support(sides, ("uz", "ry"))]
    )
    return ShellModel(patch.mesh, PLATE_SECTION, [in_plane, *edges], elements), patch


def plate_rigidity() -> float:
    """Bending rigidity D = E h³ / 12 (1 - nu²) of the plate."""
    E, h, nu = PLATE_SECTION.youngs_modulus_pa, PLATE_SECTION.thickness_m, PLATE_SECTION.poisson_ratio
    return float(E * h**3 / (12.0 * (1.0 - nu**2)))


def plate_deflection(n: int, is_clamped: bool, is_point_load: bool, elements: ElementChoice) -> float:
    """Central deflection times D / (q a⁴) or D / (P a²); n (even) elements a side. Published by Timoshenko."""
    model, patch = plate_model(n, is_clamped, elements)
    centre = patch.grid[n // 2, n // 2]
    if is_point_load:
        load = np.zeros((patch.mesh.n_vertices, 3))
        load[centre, 2] = 1.0
    else:
        load = surface_load(patch.mesh, np.array([0.0, 0.0, 1.0]))
    return plate_rigidity() * float(model.solve_static(load).displacement_m[centre, 2])


def plate_frequencies(n: int, is_clamped: bool, elements: ElementChoice) -> FloatArray:
    """Six lowest omega a² sqrt(rho h / D) of the square plate."""
    model, _ = plate_model(n, is_clamped, elements)
    h = float(PLATE_SECTION.thickness_m)
    scaled: FloatArray = compute_modes(model, 6).omega_rad_s * np.sqrt(UNIT_DENSITY * h / plate_rigidity())
    return scaled


def straight_cantilever(n_along: int, elements: ElementChoice) -> dict[str, float]:
    """Tip displacements of the MacNeal-Harder beam 6 x 0.2 x 0.1 under unit tip forces, in-plane means 0.2 deep."""
    n_deep = max(2, 2 * round(n_along / 48))
    patch = mapped_patch(n_along, n_deep, lambda s, t: (6.0 * s, 0.2 * t, np.zeros_like(s)))
    section = ShellSection(0.1, 1e7, 0.3, UNIT_DENSITY)
    model = ShellModel(patch.mesh, section, [Support(patch.grid[0])], elements)
    return {
        name: _tip_displacement(model, patch.grid[-1], axis)
        for axis, name in enumerate(("extension", "in-plane", "out-of-plane"))
    }


def curved_beam_in_plane(n_along: int, elements: ElementChoice) -> float:
    """Radial tip displacement of the MacNeal-Harder quarter-circle beam under a unit radial tip force.

    Published 0.08734, a beam formula; plane elasticity gives `curved_bar_exact`.
    """

    def arc(s: FloatArray, t: FloatArray) -> tuple[FloatArray, ...]:
        radius = 4.12 + 0.2 * t
        return radius * np.sin(0.5 * np.pi * s), radius * np.cos(0.5 * np.pi * s), np.zeros_like(s)

    patch = mapped_patch(n_along, max(2, 2 * round(n_along / 48)), arc)
    section = ShellSection(0.1, 1e7, 0.25, UNIT_DENSITY)
    model = ShellModel(patch.mesh, section, [Support(patch.grid[0])], elements)
    return _tip_displacement(model, patch.grid[-1], 0)


def curved_bar_exact() -> float:
    """Plane elasticity for the same beam: pi P (a² + b²) / (E N), Timoshenko and Goodier, curved bar with end shear."""
    a, b = 4.12, 4.32
    N = a**2 - b**2 + (a**2 + b**2) * np.log(b / a)
    force_per_thickness = 1.0 / 0.1
    return float(np.pi * force_per_thickness * (a**2 + b**2) / (1e7 * N))


def raasch_hook(n_across: int, elements: ElementChoice) -> float:
    """Tip displacement of the Raasch hook along its unit tip shear; a Kirchhoff code must not reach 4.93."""
    arcs = np.radians([60.0, 150.0])
    split = 14.0 * arcs[0] / (14.0 * arcs[0] + 46.0 * arcs[1])

    def hook(s: FloatArray, t: FloatArray) -> tuple[FloatArray, ...]:
        first = arcs[0] * np.minimum(s / split, 1.0)
        second = arcs[1] * np.maximum((s - split) / (1.0 - split), 0.0)
        heading = arcs[0] - second
        x = 14.0 * np.sin(first) + 46.0 * (np.sin(arcs[0]) - np.sin(heading))
        y = 14.0 * (1.0 - np.cos(first)) + 46.0 * (np.cos(heading) - np.cos(arcs[0]))
        return x, y, 20.0 * t

    n_along = 17 * n_across // 2
    patch = mapped_patch(n_along, n_across, hook)
    model = ShellModel(patch.mesh, ShellSection(2.0, 3300.0, 0.35, UNIT_DENSITY), [Support(patch.grid[0])], elements)
    return _tip_displacement(model, patch.grid[-1], 2)


def _tip_displacement(model: ShellModel, edge: IntArray, axis: int) -> float:
    """Mean displacement of an evenly divided edge under a unit force spread over it, along the force."""
    share = np.ones(len(edge))
    share[[0, -1]] = 0.5
    share /= share.sum()
    load = np.zeros((model.mesh.n_vertices, 3))
    load[edge, axis] = share
    return float(share @ model.solve_static(load).displacement_m[edge, axis])


REFERENCE_SECTION = ShellSection(0.5e-3, 100e3, 0.45, 1060.0)
"""The reference duct (case A): R 4 mm, L 40 mm, wall 0.5 mm, E 100 kPa, nu 0.45."""


def reference_duct(n_around: int, n_along: int, elements: ElementChoice) -> ShellModel:
    """Clamped-free cylinder, mid-surface radius 4 mm, length 40 mm."""
    mesh = parametric_duct(DuctGeometry(4e-3, 40e-3, n_around, n_along))
    return ShellModel(mesh, REFERENCE_SECTION, [clamp(mesh)], elements)


def duct_droop_m(n_around: int, n_along: int, elements: ElementChoice) -> float:
    """Mean drop of the free ring under 2 m/s² sideways, translations of the other ring held."""
    mesh = parametric_duct(DuctGeometry(4e-3, 40e-3, n_around, n_along))
    support = Support(mesh.vertex_sets["clamped"], ("ux", "uy", "uz"))
    model = ShellModel(mesh, REFERENCE_SECTION, [support], elements)
    solution = model.solve_static(model.mass_kg[:, None] * np.array([0.0, 2.0, 0.0]))
    return float(solution.displacement_m[mesh.vertex_sets["mouth"], 1].mean())


DUCT_RITZ_HZ = {
    "(1,1)": 9.0290,
    "torsion": 35.65,
    "(2,1)": 41.701,
    "(1,2)": 42.668,
    "(2,2)": 46.978,
    "(0,1)": 60.910,
    "(2,3)": 64.930,
    "(2,4)": 94.043,
    "(1,3)": 94.570,
    "torsion 2": 106.94,
    "(3,1)": 117.08,
    "(3,2)": 120.61,
    "(3,3)": 127.34,
    "(2,5)": 128.94,
    "(3,4)": 139.57,
    "(1,4)": 147.45,
}
"""Sanders thin-shell Rayleigh-Ritz frequencies of the reference duct, (circumferential waves, axial order)."""


def sorted_duct_frequencies_hz() -> list[float]:
    """Published frequencies of the reference duct in ascending order, each mode with n >= 1 counted twice."""
    single = ("torsion", "torsion 2", "(0,1)")
    return sorted(f for name, f in DUCT_RITZ_HZ.items() for _ in range(1 if name in single else 2))
