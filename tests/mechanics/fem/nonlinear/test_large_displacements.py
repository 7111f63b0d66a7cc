"""Paths of equilibrium against the literature on large displacements of shells, and against CalculiX on the duct."""

import numpy as np
import pytest

from services.mechanics.fem import ElementChoice, ShellModel, ShellSection, Support, clamp, pressure_load
from services.mechanics.fem.nonlinear import CorotationalShell, NonlinearLoad, PathSettings, trace_path
from services.mechanics.surface.tube import DuctGeometry, parametric_duct
from tests.mechanics.fem.nonlinear.shells import along_edge, cantilever, dead_load, hinged_roof

SZE_SHEAR = {0.25: (3.015, 0.563), 0.5: (4.933, 1.604), 0.75: (6.031, 2.541), 1.0: (6.698, 3.286)}
"""Sze, Liu and Lo, FEAD 40:1551 (2004): deflection and shortening of the tip by part of the load."""
PINCH = {0.2: 0.876, 0.5: 0.746, 1.0: 0.642}
"""CalculiX, S8R with large displacements: force over the linear force at 10, 25, 50 % closure of the duct's mouth."""


@pytest.mark.parametrize("membrane", ["cst", "andes"])
def test_cantilever_under_shear(membrane):
    shell, mesh, index = cantilever(membrane=membrane)
    path = trace_path(shell, dead_load(mesh, fz=(index[-1], 4.0 * along_edge(3))), PathSettings(n_steps=4))
    assert [point.part for point in path] == list(SZE_SHEAR)
    for point, (deflection, shortening) in zip(path, SZE_SHEAR.values(), strict=True):
        moved = (point.at.position_m - mesh.vertices_m)[index[-1, 1]]
        assert moved[[2, 0]] == pytest.approx([deflection, -shortening], rel=0.003)
        assert point.reaction[:, 2].sum() == pytest.approx(-4.0 * point.part, rel=1e-6)


def test_cantilever_under_a_moment_closes_to_a_circle():
    shell, mesh, index = cantilever()
    moment = 2.0 * np.pi * 100.0 / 10.0
    path = trace_path(shell, dead_load(mesh, my=(index[-1], -moment * along_edge(3))), PathSettings(n_steps=10))
    end = path[-1].at
    assert end.position_m[index[-1]] == pytest.approx(mesh.vertices_m[index[0]], abs=0.02)
    assert end.position_m[index[8, 1]] == pytest.approx([0.0, 0.5, 10.0 / np.pi], abs=0.03)
    assert shell.energy_j(end) == pytest.approx(0.5 * moment * 2.0 * np.pi, rel=1e-3)


@pytest.mark.parametrize(("thickness", "limit", "lowest"), [(12.7, 2226.0, 512.0), (6.35, 587.0, -385.0)])
def test_hinged_roof_snaps_through_and_back(thickness, limit, lowest):
    """Limit loads as in Sze, Liu and Lo's figures; the values are of this method on a mesh of twice the fineness."""
    shell, mesh, index = hinged_roof(thickness)
    load = dead_load(mesh, fz=([index[0, 0]], -3000.0 / 4.0))
    path = trace_path(shell, load, PathSettings(n_steps=8, control="arc_length"))
    part = 3000.0 * np.array([point.part for point in path])
    top = int(np.flatnonzero(np.diff(part) < 0.0)[0])
    assert part[top] == pytest.approx(limit, rel=0.02)
    assert part[top:].min() == pytest.approx(lowest, abs=0.02 * limit)
    assert path[-1].part == 1.0


def squeezed_duct():
    """The reference duct, jaws 4 mm wide on its mouth that close it by half; returns shell, load and one jaw."""
    mesh = parametric_duct(DuctGeometry(radius_m=0.004, length_m=0.04, n_around=24, n_along=36, wall_thickness_m=5e-4))
    x, y, z = mesh.vertices_m.T
    jaws = [np.flatnonzero((x > 0.0359) & (side * y > 0.0039) & (abs(z) < 1e-6)) for side in (1.0, -1.0)]
    supports = [clamp(mesh), *(Support(jaw.astype(np.int32), ("uy",)) for jaw in jaws)]
    model = ShellModel(mesh, ShellSection(5e-4, 1e5, 0.45, 1060.0), supports, ElementChoice("andes", "dkt"))
    imposed = np.zeros((mesh.n_vertices, 6))
    imposed[jaws[0], 1], imposed[jaws[1], 1] = -0.002, 0.002
    return CorotationalShell(model), NonlinearLoad(np.zeros_like(imposed), 0.0, imposed), jaws[1]


def test_squeezed_duct_gives_way_as_in_calculix():
    shell, load, jaw = squeezed_duct()
    linear = shell.model.solve_static(load.dead, load.imposed).reaction[jaw, 1].sum()
    path = trace_path(shell, load, PathSettings(n_steps=10))
    ratio = {round(point.part, 3): point.reaction[jaw, 1].sum() / (point.part * linear) for point in path}
    assert {part: ratio[part] for part in PINCH} == pytest.approx(PINCH, rel=0.02)


def test_a_path_controlled_by_the_load_ends_where_the_roof_snaps_and_says_how_to_go_on():
    shell, mesh, index = hinged_roof(12.7, n=4)
    load = dead_load(mesh, fz=([index[0, 0]], -3000.0 / 4.0))
    with pytest.raises(ValueError, match=r"no equilibrium was found beyond 0\.73.* arc_length"):
        trace_path(shell, load, PathSettings(n_steps=4))


def test_a_duct_sucked_empty_stays_near_the_linear_solution_below_its_buckling_load():
    mesh = parametric_duct(DuctGeometry(radius_m=0.004, length_m=0.02, n_around=12, n_along=10, wall_thickness_m=5e-4))
    model = ShellModel(mesh, ShellSection(5e-4, 1e5, 0.45, 1060.0), [clamp(mesh)])
    zero = np.zeros((mesh.n_vertices, 6))
    path = trace_path(CorotationalShell(model), NonlinearLoad(zero, -1e-3, zero), PathSettings(n_steps=1))
    linear = model.solve_static(pressure_load(mesh, -1e-3)).displacement_m
    moved = path[-1].at.position_m - mesh.vertices_m
    assert np.linalg.norm(moved - linear) < 1e-4 * np.linalg.norm(linear)
