"""Paths of equilibrium against the literature on large displacements of shells, and against CalculiX on the duct."""

from dataclasses import replace

import numpy as np
import pytest

from tests.by_day import by_day
from trocar.services.mechanics.fem import ShellModel, ShellSection, clamp, pressure_load
from trocar.services.mechanics.fem.nonlinear import (
    CorotationalShell,
    NonlinearLoad,
    PathSettings,
    newton,
    trace_path,
)
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct
from trocar.studies.fem import arc_length
from trocar.studies.fem.arc_length import trace_arc_length
from trocar.studies.published.large_displacements import (
    DIAPHRAGMS,
    HALF_CYLINDER,
    PINCH,
    PULLED,
    ROOF_LIMITS,
    ROOF_PATHS,
    SHEAR,
    cantilever,
    closed_hemisphere,
    cylinder_between_diaphragms,
    force_over_linear,
    hinged_roof,
    off_the_path,
    pulled_cylinder,
    pushed_half_cylinder,
    squeezed_duct,
)


@pytest.mark.parametrize("membrane", ["cst", "andes"])
def test_cantilever_under_shear(membrane):
    problem = cantilever("shear", membrane=membrane)
    path = trace_path(problem.shell, problem.load, PathSettings(n_steps=4))
    assert [point.part for point in path] == list(SHEAR)
    for point, (deflection, shortening) in zip(path, SHEAR.values(), strict=True):
        assert problem.moved(point)[0, [2, 0]] == pytest.approx([deflection, -shortening], rel=0.003)
        assert point.reaction[:, 2].sum() == pytest.approx(-4.0 * point.part, rel=1e-6)


@pytest.fixture(scope="module")
def bent():
    """A strip under a moment that bends it to a circle, and the tenths of its way."""
    problem = cantilever("moment")
    return problem, trace_path(problem.shell, problem.load, PathSettings(n_steps=10))


def test_cantilever_under_a_moment_closes_to_a_circle(bent):
    problem, (*_, end) = bent
    tip, middle = problem.moved(end)
    assert tip == pytest.approx([-10.0, 0.0, 0.0], abs=0.02)
    assert middle == pytest.approx([-5.0, 0.0, 10.0 / np.pi], abs=0.03)
    moment = 2.0 * np.pi * 100.0 / 10.0
    assert problem.shell.energy_j(end.at) == pytest.approx(0.5 * moment * 2.0 * np.pi, rel=1e-3)


def test_the_way_to_the_circle_is_the_closed_form(bent):
    """At every tenth of the moment the strip is an arc of its length."""
    problem, path = bent
    for point in path:
        angle = 2.0 * np.pi * point.part
        tip = problem.moved(point)[0]
        arc = 10.0 * np.array([np.sin(angle) / angle - 1.0, 0.0, (1.0 - np.cos(angle)) / angle])
        assert tip == pytest.approx(arc, abs=0.03)


def test_a_cylinder_between_diaphragms_gives_way_as_published():
    """At a twentieth of its load, after which folds form that want a finer mesh."""
    problem = cylinder_between_diaphragms(24, 24)
    load = replace(problem.load, dead=0.05 * problem.load.dead)
    at_force, beside = problem.moved(trace_path(problem.shell, load, PathSettings(n_steps=4))[-1])
    assert -at_force[2] == pytest.approx(DIAPHRAGMS[0.05][0], rel=0.01)
    assert beside[0] == pytest.approx(DIAPHRAGMS[0.05][1], rel=0.05)


def test_a_cylinder_pulled_apart_ends_where_published():
    """Stretched with its circumference straightened, it has turned its curvature about on the way."""
    problem = pulled_cylinder(12, 8)
    path = trace_arc_length(problem.shell, problem.load, PathSettings(n_steps=20))
    moved = problem.moved(path[-1])
    assert [moved[0, 2], -moved[1, 0], -moved[2, 0]] == pytest.approx(PULLED[path[-1].part], rel=0.015)


@pytest.mark.long
def test_a_half_cylinder_pushed_at_its_free_end_folds_as_far_as_published():
    """By 1.7 radii; 12, 16 and 20 triangles along each side come to within 2.1, 1.1 and less than 1 %."""
    problem = pushed_half_cylinder(20, 20)
    end = trace_path(problem.shell, problem.load, PathSettings(n_steps=10))[-1]
    assert -problem.moved(end)[0, 2] == pytest.approx(HALF_CYLINDER[end.part], rel=0.01)


def test_a_hemisphere_without_a_hole_gives_way_as_published_to_small_forces():
    """Simo, Fox and Rifai (CMAME 73:53, 1989) have 0.0924 under unit forces."""
    problem = closed_hemisphere(16)
    moved = problem.shell.model.solve_static(problem.load.dead).displacement_m[problem.watched] / 200.0
    assert [moved[0, 0], -moved[1, 1]] == pytest.approx([0.0924, 0.0924], rel=0.01)


@pytest.mark.parametrize(("thickness", "lowest"), by_day([(6.35, -385.0)], [(12.7, 512.0)]))
def test_hinged_roof_snaps_through_and_back(thickness, lowest):
    """The limit is published; the lowest load is of this method on a mesh of twice the fineness."""
    limit = 3000.0 * ROOF_LIMITS[thickness][0]
    problem = hinged_roof(thickness)
    path = trace_arc_length(problem.shell, problem.load, PathSettings(n_steps=8))
    load = 3000.0 * np.array([point.part for point in path])
    top = int(np.flatnonzero(np.diff(load) < 0.0)[0])
    assert load[top] == pytest.approx(limit, rel=0.02)
    assert load[top:].min() == pytest.approx(lowest, abs=0.02 * limit)
    assert path[-1].part == 1.0


@pytest.mark.long
@pytest.mark.parametrize(("thickness", "most"), [(12.7, 0.007), (6.35, 0.009)])
def test_the_path_of_a_hinged_roof_is_the_published_one(thickness, most):
    """At all of its points, where the load falls and where the middle comes back up as well."""
    problem = hinged_roof(thickness)
    path = trace_arc_length(problem.shell, problem.load, PathSettings(n_steps=40))
    own = np.array([(0.0, 0.0), *((point.part, -problem.moved(point)[0, 2]) for point in path)])
    off = off_the_path(ROOF_PATHS[thickness], own)
    assert off.max() < most


def test_squeezed_duct_gives_way_as_in_calculix():
    problem = squeezed_duct()
    ratio = force_over_linear(problem, trace_path(problem.shell, problem.load, PathSettings(n_steps=10)))
    assert {part: ratio[part] for part in PINCH} == pytest.approx(PINCH, rel=0.02)


def test_a_path_controlled_by_the_load_ends_where_the_roof_snaps_and_says_how_to_go_on():
    problem = hinged_roof(12.7, n=4)
    with pytest.raises(ValueError, match=r"no equilibrium was found beyond 0\.73.* arc-length"):
        trace_path(problem.shell, problem.load, PathSettings(n_steps=4))


def test_a_path_along_its_length_that_is_lost_says_how_to_go_on(monkeypatch):
    """Which is not the way that it went already."""
    monkeypatch.setattr(newton, "MOST_ITERATIONS", 2)
    monkeypatch.setattr(arc_length, "MOST_ITERATIONS", 2)
    problem = hinged_roof(12.7, n=4)
    with pytest.raises(ValueError, match=r"no equilibrium was found beyond .* more n_steps than 3 begin with shorter"):
        trace_arc_length(problem.shell, problem.load, PathSettings(n_steps=3))


def test_every_load_step_is_a_point_also_where_one_was_halved(monkeypatch):
    """A published table is met at its own parts of the load."""
    solve, failed = newton.Newton.solve, []

    def fail_once(self, at, part_now, part):
        if part_now > 0.2 and not failed:
            failed.append(part)
            raise newton.NotConvergedError("residual 1 after 25 iterations")
        return solve(self, at, part_now, part)

    monkeypatch.setattr(newton.Newton, "solve", fail_once)
    problem = cantilever("shear", 8)
    path = trace_path(problem.shell, problem.load, PathSettings(n_steps=10))
    assert failed
    parts = [point.part for point in path]
    assert parts == sorted(set(parts))
    assert len(parts) > 10
    assert set(np.arange(1, 11) / 10) <= set(parts)


def test_a_long_path_says_which_steps_take_it_further():
    """Points times the longest step are what it comes to: of steps as long as they may be fewer are longer."""
    problem = hinged_roof(12.7, n=4)
    with pytest.raises(ValueError, match=r"after 5 points the path is at 0\.\d+ of the load; fewer n_steps"):
        trace_arc_length(problem.shell, problem.load, PathSettings(n_steps=100), most_points=5)


def test_a_last_step_that_the_load_cannot_control_is_made_along_the_path(monkeypatch):
    """Where the load is full just beyond a fold, Newton's method at the full load may find nothing from afar."""
    solve, failed = newton.Newton.solve, []

    def fail_once(self, *args):
        if not failed:
            failed.append(args)
            raise newton.NotConvergedError("residual 1 after 25 iterations")
        return solve(self, *args)

    monkeypatch.setattr(newton.Newton, "solve", fail_once)
    problem = hinged_roof(12.7, n=4)
    path = trace_arc_length(problem.shell, problem.load, PathSettings(n_steps=8))
    assert failed
    assert path[-1].part == 1.0


def test_a_duct_sucked_empty_stays_near_the_linear_solution_below_its_buckling_load():
    mesh = parametric_duct(DuctGeometry(radius_m=0.004, length_m=0.02, n_around=12, n_along=10, wall_thickness_m=5e-4))
    model = ShellModel(mesh, ShellSection(5e-4, 1e5, 0.45, 1060.0), [clamp(mesh)])
    zero = np.zeros((mesh.n_vertices, 6))
    path = trace_path(CorotationalShell(model), NonlinearLoad(zero, -1e-3, zero), PathSettings(n_steps=1))
    linear = model.solve_static(pressure_load(mesh, -1e-3)).displacement_m
    moved = path[-1].at.position_m - mesh.vertices_m
    assert np.linalg.norm(moved - linear) < 1e-4 * np.linalg.norm(linear)
