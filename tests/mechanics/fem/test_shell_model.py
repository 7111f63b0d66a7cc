"""Supports, constraints, statics and the refusals of a model."""

import numpy as np
import pytest

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
from trocar.studies.fem.loads import point_load, surface_load
from trocar.studies.published.shells import REFERENCE_SECTION, mapped_patch

DUCT = parametric_duct(DuctGeometry(4e-3, 40e-3, 12, 16))


@pytest.fixture(scope="module")
def model():
    return ShellModel(DUCT, REFERENCE_SECTION, [clamp(DUCT)])


def test_reactions_balance_the_load_in_force_and_moment(model):
    rng = np.random.default_rng(2)
    load = np.zeros((DUCT.n_vertices, 6))
    load[rng.integers(20, DUCT.n_vertices, 5)] = rng.standard_normal((5, 6)) * [1, 1, 1, 1e-3, 1e-3, 1e-3] * 1e-3
    solution = model.solve_static(load)
    total = load + solution.reaction
    moment = np.cross(DUCT.vertices_m, total[:, :3]) + total[:, 3:]
    assert np.abs(total[:, :3].sum(axis=0)).max() < 1e-12 * np.abs(load).sum()
    assert np.abs(moment.sum(axis=0)).max() < 1e-13 * np.abs(load).sum()
    assert solution.residual < 1e-12


def test_stiffness_is_symmetric_positive_definite_once_supported(model):
    K = model.K_free.toarray()
    assert np.array_equal(K, K.T)
    np.linalg.cholesky(K)


def test_penalty_agrees_with_elimination(model):
    load = point_load(DUCT, int(DUCT.vertex_sets["mouth"][2]), np.array([0.0, -1e-3, 2e-3]))
    penalty = ShellModel(DUCT, REFERENCE_SECTION, [clamp(DUCT)], constraints="penalty")
    exact, found = model.solve_static(load), penalty.solve_static(load)
    scale = np.abs(exact.displacement_m).max()
    assert np.abs(found.displacement_m - exact.displacement_m).max() < 1e-6 * scale
    assert np.abs(found.reaction - exact.reaction).max() < 1e-6 * np.abs(exact.reaction).max()


def test_penalty_follows_imposed_displacements(model):
    imposed = np.zeros((DUCT.n_vertices, 6))
    imposed[:, 1] = 1e-4
    none = np.zeros((DUCT.n_vertices, 3))
    penalty = ShellModel(DUCT, REFERENCE_SECTION, [clamp(DUCT)], constraints="penalty")
    for shifted in (model, penalty):
        moved = shifted.solve_static(none, imposed=imposed).displacement_m
        assert np.abs(moved - [0.0, 1e-4, 0.0]).max() < 1e-9


def test_reciprocity_of_point_loads(model):
    """Maxwell-Betti: displacement at b under a load at a equals that at a under the load at b."""
    a, b = 60, int(DUCT.vertex_sets["mouth"][5])
    n_a, n_b = np.array([0.0, 1.0, 0.0]), np.array([0.6, 0.0, 0.8])
    at_b = model.solve_static(point_load(DUCT, a, n_a)).displacement_m[b] @ n_b
    at_a = model.solve_static(point_load(DUCT, b, n_b)).displacement_m[a] @ n_a
    assert at_a == pytest.approx(at_b, rel=1e-10)


@pytest.mark.parametrize("membrane", ["cst", "andes"])
def test_pressurised_tube_widens_by_the_hoop_formula(membrane):
    """Far from the clamp u_r = p R² / (E h) for open ends, on the polygon's own mean radius."""
    geometry = DuctGeometry(4e-3, 40e-3, 40, 40)
    mesh = parametric_duct(geometry)
    model = ShellModel(mesh, REFERENCE_SECTION, [clamp(mesh)], ElementChoice(membrane, "dkt"))
    pressure = 10.0
    u = model.solve_static(pressure_load(mesh, pressure)).displacement_m
    middle = np.abs(mesh.vertices_m[:, 0] - 20e-3) < 5e-3
    outward = mesh.vertices_m[middle, 1:] / 4e-3
    radial = np.sum(u[middle, 1:] * outward, axis=1).mean()
    assert radial == pytest.approx(pressure * 4e-3**2 / (100e3 * 0.5e-3), rel=0.01)


def test_a_load_on_the_surface_sums_to_force_times_area():
    patch = mapped_patch(3, 2, lambda s, t: (2 * s, 3 * t, np.zeros_like(s)))
    assert surface_load(patch.mesh, np.array([0.0, 0.0, 5.0])).sum(axis=0) == pytest.approx([0, 0, 30])
    assert pressure_load(patch.mesh, 5.0).sum(axis=0) == pytest.approx([0, 0, -30])


def test_solving_is_linear_and_takes_many_loads_at_once(model):
    rhs = np.random.default_rng(0).standard_normal((len(model.free_dofs), 3))
    together = model.solve_free(rhs)
    assert np.abs(model.K_free @ together - rhs).max() < 1e-9
    assert np.allclose(model.solve_free(rhs[:, 1]), together[:, 1], rtol=1e-9)


def test_an_unsupported_piece_is_refused_with_its_place():
    far = TriangleMesh(DUCT.vertices_m + np.array([0.1, 0.0, 0.0]), DUCT.triangles)
    both = TriangleMesh(
        np.concatenate([DUCT.vertices_m, far.vertices_m]),
        np.concatenate([DUCT.triangles, far.triangles + DUCT.n_vertices]),
        DUCT.vertex_sets,
    )
    with pytest.raises(ValueError, match=r"round \[120\.0, .* mm is not held: .* 6 of 6 ways"):
        ShellModel(both, REFERENCE_SECTION, [clamp(both)])


def test_a_hinge_leaves_one_way_to_move():
    patch = mapped_patch(3, 3, lambda s, t: (s, t, np.zeros_like(s)))
    hinge = Support(patch.grid[0], ("ux", "uy", "uz"))
    with pytest.raises(ValueError, match="1 of 6 ways"):
        ShellModel(patch.mesh, REFERENCE_SECTION, [hinge])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda v, t: (np.vstack([v, [9, 9, 9]]), t), r"vertex 221 belongs to no triangle"),
        (lambda v, t: (v, np.vstack([t, [30, 31, 30]])), r"triangle 384 at .* has no area"),
    ],
)
def test_a_broken_mesh_is_refused_with_its_place(change, message):
    mesh = TriangleMesh(*change(DUCT.vertices_m, DUCT.triangles), DUCT.vertex_sets)
    message = message.replace("221", str(DUCT.n_vertices)).replace("384", str(DUCT.n_triangles))
    with pytest.raises(ValueError, match=message):
        ShellModel(mesh, REFERENCE_SECTION, [clamp(mesh)])


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: ShellModel(DUCT, REFERENCE_SECTION, [Support(np.arange(3), ("ux", "uq"))]), "unknown dof 'uq'"),
        (lambda: ShellModel(DUCT, REFERENCE_SECTION, [Support(np.array([9999]))]), "vertex 9999 does not exist"),
        (lambda: ShellModel(DUCT, REFERENCE_SECTION, [clamp(DUCT, "rim")]), "no vertex set 'rim'; it has: clamped"),
        (lambda: ShellSection(0.0, 1e5, 0.3, 1e3), "thickness_m must be positive"),
        (lambda: ShellSection(1e-3, 1e5, 0.6, 1e3), "must not exceed 0.5"),
        (
            lambda: ShellModel(DUCT, ShellSection(np.ones(3), 1e5, 0.3, 1e3), [clamp(DUCT)]),
            r"thickness_m has shape \(3,\)",
        ),
        (
            lambda: ShellModel(DUCT, REFERENCE_SECTION, [clamp(DUCT)], ElementChoice("cst", "mitc")),
            "unknown bending element 'mitc'; known: dkt, dkmt, reissner, tocher",
        ),
    ],
)
def test_bad_input_is_one_clear_sentence(build, message):
    with pytest.raises(ValueError, match=message):
        build()


def test_load_of_another_mesh_is_refused(model):
    with pytest.raises(ValueError, match=r"load has shape \(3, 3\)"):
        model.solve_static(np.zeros((3, 3)))
