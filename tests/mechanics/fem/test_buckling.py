"""Linear buckling against Timoshenko and Gere's plates, columns, cylinders and rings, and the terms it is made of."""

import numpy as np
import pytest

from tests.mechanics.fem.patches import NU, SECTION, STRAIN, constant_state, distorted_square, random_rotation
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
from trocar.studies.fem.geometric import geometric_stiffness, membrane_forces, pressure_stiffness
from trocar.studies.published.buckling import (
    PLATE_COEFFICIENT,
    column_buckling,
    cylinder_buckling,
    plate_buckling,
    ring_buckling,
)

CST, ANDES = ElementChoice("cst", "dkt"), ElementChoice("andes", "dkt")
both = pytest.mark.parametrize("elements", [CST, ANDES], ids=lambda e: e.membrane)


@both
@pytest.mark.parametrize(("load", "is_clamped"), PLATE_COEFFICIENT)
def test_square_plates_buckle_at_the_published_loads(load, is_clamped, elements):
    found = plate_buckling(16, load, is_clamped, elements)[0]
    assert found == pytest.approx(PLATE_COEFFICIENT[load, is_clamped], rel=2e-3)


@both
def test_load_factors_converge_with_the_square_of_the_mesh_size(elements):
    n = np.array([6, 12, 24])
    error = [plate_buckling(k, "one way", False, elements)[0] / 4.0 - 1.0 for k in n]
    rate = -np.polyfit(np.log(n), np.log(error), 1)[0]
    assert rate == pytest.approx(2.0, abs=0.15)


def test_higher_factors_of_a_plate_are_those_of_more_waves():
    """(m + 1 / m)² for m = 1, 2, 3 half waves along the push and one across; 16 for two by two."""
    assert plate_buckling(24, "one way", False, CST, 4) == pytest.approx([4.0, 6.25, 100 / 9, 16.0], rel=5e-3)


def test_a_long_tube_buckles_as_a_column():
    """Overall bending is stretch of the wall: the terms in the plane of the triangles count here, and only they."""
    assert column_buckling(32, 80, CST) == pytest.approx(1.0, abs=0.02)


@both
def test_a_cylinder_under_axial_load_buckles_at_the_classical_stress(elements):
    assert cylinder_buckling(72, 12, elements) == pytest.approx(1.0, abs=0.03)


@both
def test_a_ring_under_outside_pressure_buckles_as_bresse_says(elements):
    """A pressure of fixed direction would give 1.07 and 1.34 here, and part the double shapes."""
    assert ring_buckling(36, elements) == pytest.approx([1.0, 1.0, 8 / 3, 8 / 3], rel=0.02)


def test_a_stretched_tube_does_not_buckle():
    mesh = parametric_duct(DuctGeometry(4e-3, 40e-3, 12, 12))
    model = ShellModel(mesh, ShellSection(5e-4, 1e5, 0.0, 1.0), [clamp(mesh)])
    pull = np.zeros((mesh.n_vertices, 3))
    pull[mesh.vertex_sets["mouth"], 0] = 1e-3
    with pytest.raises(ValueError, match="no multiple of the loads buckles this shell"):
        compute_buckling(model, model.solve_static(pull), 1)


def deformed_patch(kind, elements):
    """A distorted patch, turned anyhow, in a constant strain; also how it is turned."""
    flat, _ = distorted_square(4)
    R = random_rotation(2)
    mesh = TriangleMesh(flat.vertices_m @ R.T, flat.triangles)
    imposed = (constant_state(flat.vertices_m, kind).reshape(-1, 2, 3) @ R.T).reshape(-1, 6)
    model = ShellModel(mesh, SECTION, [Support(np.arange(mesh.n_vertices))], elements)
    return model, model.solve_static(np.zeros((mesh.n_vertices, 3)), imposed)


@both
@pytest.mark.parametrize("kind", STRAIN)
def test_membrane_forces_of_a_constant_strain_are_exact_on_any_mesh(kind, elements):
    model, solution = deformed_patch(kind, elements)
    xx, yy, xy = np.array(STRAIN[kind]) * SECTION.youngs_modulus_pa * SECTION.thickness_m / (1 - NU**2)
    exact = xx + NU * yy, yy + NU * xx, 0.5 * (1 - NU) * xy
    forces = membrane_forces(model, solution)
    trace, determinant = exact[0] + exact[1], exact[0] * exact[1] - exact[2] ** 2
    assert forces[:, 0] + forces[:, 1] == pytest.approx(np.full(len(forces), trace), abs=1e-9)
    assert forces[:, 0] * forces[:, 1] - forces[:, 2] ** 2 == pytest.approx(
        np.full(len(forces), determinant), rel=1e-9, abs=1e-12
    )


def test_a_rigid_turn_leaves_the_energy_of_a_stressed_shell_alone():
    """The second order of a turn moves the forces that hold the stress; K_g takes just that work back."""
    model, solution = deformed_patch("stretch x", CST)
    x, force = model.mesh.vertices_m, solution.reaction[:, :3]
    turns = np.zeros((model.mesh.n_vertices, 6, 3))
    for k, axis in enumerate(np.eye(3)):
        turns[:, :3, k], turns[:, 3:, k] = np.cross(axis, x), axis
    flat = turns.reshape(-1, 3)
    found = flat.T @ (geometric_stiffness(model, membrane_forces(model, solution)) @ flat)
    work = [[-np.sum(force * np.cross(a, np.cross(b, x))) for b in np.eye(3)] for a in np.eye(3)]
    assert found == pytest.approx(0.5 * (np.array(work) + np.transpose(work)), abs=1e-10 * np.abs(work).max())


def test_the_stiffness_of_a_pressure_is_the_change_of_its_forces():
    """On a closed surface, where it is symmetric."""
    trimesh = pytest.importorskip("trimesh", reason="the mesh extra is not installed")
    ball = trimesh.creation.icosphere(subdivisions=1)
    mesh = TriangleMesh(np.asarray(ball.vertices), np.asarray(ball.faces))
    model = ShellModel(mesh, ShellSection(0.01, 1e5, 0.3, 1.0), [Support(np.arange(3))])
    d = 1e-3 * np.random.default_rng(3).standard_normal((mesh.n_vertices, 3))
    moved = [pressure_load(TriangleMesh(mesh.vertices_m + sign * d, mesh.triangles), 7.0) for sign in (1, -1)]
    full = np.hstack([d, np.zeros_like(d)]).ravel()
    change = -(pressure_stiffness(model, 7.0) @ full).reshape(-1, 6)
    assert change[:, :3] == pytest.approx(0.5 * (moved[0] - moved[1]), abs=1e-12)
    assert not change[:, 3:].any()
