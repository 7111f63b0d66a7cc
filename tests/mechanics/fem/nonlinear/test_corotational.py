"""Corotational triangles: forces are the gradient of an energy, the tangent is theirs, a rigid motion is free."""

import numpy as np
import pytest
from scipy.sparse import csr_array, diags_array

from trocar.services.mechanics.fem import ElementChoice, ShellModel, ShellSection, clamp
from trocar.services.mechanics.fem.nonlinear import Configuration, CorotationalShell, NonlinearLoad
from trocar.services.mechanics.fem.nonlinear.newton import Factors
from trocar.services.mechanics.fem.nonlinear.rotations import exponential, logarithm, moment_correction, vector_rate
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct

UNIT = np.array([1.0, 1.0, 1.0, 1e3, 1e3, 1e3])
"""Displacements in mm beside rotations in rad: entries of a tangent then compare."""


@pytest.fixture(params=["cst", "andes"])
def model(request):
    mesh = parametric_duct(DuctGeometry(radius_m=0.004, length_m=0.02, n_around=6, n_along=4, wall_thickness_m=5e-4))
    return ShellModel(mesh, ShellSection(5e-4, 1e5, 0.45, 1060.0), [clamp(mesh)], ElementChoice(request.param, "dkt"))


@pytest.fixture
def crumpled(model):
    """Displaced by a tenth of the radius and turned by 0.2 rad, at random."""
    step = np.random.default_rng(3).normal(size=(model.mesh.n_vertices, 6)) * np.repeat([4e-4, 0.2], 3)
    return Configuration.undeformed(model).moved(step.ravel())


def directions(model, n=6, seed=5):
    unit = np.tile(1e-3 * UNIT, model.mesh.n_vertices)
    return np.random.default_rng(seed).normal(size=(n, len(unit))) * unit


def test_at_rest_there_is_no_force_and_the_tangent_is_the_linear_stiffness(model):
    shell, rest = CorotationalShell(model), Configuration.undeformed(model)
    scale = abs(model.K_full.toarray()).max()
    assert abs(shell.forces(rest)).max() < 1e-15 * scale
    assert abs((shell.tangent(rest) - model.K_full).toarray()).max() < 1e-14 * scale


def test_forces_are_the_gradient_of_the_energy(model, crumpled):
    shell = CorotationalShell(model)
    force = shell.forces(crumpled)
    for step in 1e-4 * directions(model):
        slope = 0.5 * (shell.energy_j(crumpled.moved(step)) - shell.energy_j(crumpled.moved(-step)))
        assert slope == pytest.approx(force @ step, rel=1e-6)


def test_what_is_kept_of_one_configuration_is_told_of_no_other(model, crumpled):
    shell, other = CorotationalShell(model), crumpled.moved(directions(model, 1)[0])
    for at in (crumpled, other, crumpled):
        alone = CorotationalShell(model)
        np.testing.assert_array_equal(shell.forces(at), alone.forces(at))
        np.testing.assert_array_equal(shell.tangent(at).toarray(), alone.tangent(at).toarray())


def test_the_tangent_is_the_derivative_of_the_forces(model, crumpled):
    shell = CorotationalShell(model)
    K = shell.tangent(crumpled)
    for step in 1e-4 * directions(model):
        change = 0.5 * (shell.forces(crumpled.moved(step)) - shell.forces(crumpled.moved(-step)))
        assert np.linalg.norm(change - K @ step) < 1e-6 * np.linalg.norm(change)


def test_a_rigid_motion_turns_the_forces_and_leaves_the_energy(model, crumpled):
    shell = CorotationalShell(model)
    R = exponential(np.array([1.0, 2.0, -1.5]))
    moved = Configuration(crumpled.position_m @ R.T + 0.3, R @ crumpled.rotation)
    turned = shell.forces(crumpled).reshape(-1, 3) @ R.T
    assert shell.energy_j(moved) == pytest.approx(shell.energy_j(crumpled), rel=1e-11)
    assert np.allclose(shell.forces(moved).reshape(-1, 3), turned, rtol=0.0, atol=1e-11 * abs(turned).max())


def test_no_corner_is_the_first(model, crumpled):
    mesh = model.mesh
    turned = TriangleMesh(mesh.vertices_m, np.roll(mesh.triangles, 1, axis=1), mesh.vertex_sets)
    other = ShellModel(turned, model.section, [clamp(turned)], model.elements)
    one, two = CorotationalShell(model), CorotationalShell(other)
    assert two.energy_j(crumpled) == pytest.approx(one.energy_j(crumpled), rel=1e-11)


def test_a_pressure_follows_the_wall_and_its_stiffness_is_its_derivative(model, crumpled):
    n = model.mesh.n_vertices
    load = NonlinearLoad(np.zeros((n, 6)), 250.0, np.zeros((n, 6)))
    K = load.stiffness(model.mesh, crumpled.position_m)
    for step in 1e-3 * directions(model):
        after, before = (load.forces(model.mesh, crumpled.moved(sign * step).position_m) for sign in (1.0, -1.0))
        assert np.linalg.norm(0.5 * (after - before) + K @ step) < 1e-9 * np.linalg.norm(K @ step)


@pytest.mark.parametrize("angle", [1e-6, 0.01, 0.049, 0.051, 1.0, 3.0])
def test_rates_of_a_rotation_vector_against_differences(angle):
    rng = np.random.default_rng(2)
    theta, moment = rng.normal(size=(2, 3))
    theta *= angle / np.linalg.norm(theta)
    R, h = exponential(theta), 1e-5
    ends = [[logarithm(exponential(sign * h * axis) @ R) for sign in (1.0, -1.0)] for axis in np.eye(3)]
    rate = np.array([(after - before) / (2.0 * h) for after, before in ends]).T
    turned = np.array([(vector_rate(a).T @ moment - vector_rate(b).T @ moment) / (2.0 * h) for a, b in ends]).T
    assert np.allclose(vector_rate(theta), rate, atol=1e-8)
    assert np.allclose(moment_correction(theta, moment), turned, atol=1e-8)


def test_factors_of_a_tangent_are_as_many_in_any_unit_of_length(model):
    """Newtons beside newton metres must not look like tiny pivots, which are exchanged at the price of the sparsity."""
    K = csr_array(model.K_free)
    to_unit = diags_array(np.tile(UNIT**-2, K.shape[0] // 6))
    plain, other = Factors.of(K), Factors.of((to_unit @ K @ to_unit).tocsr())
    assert other.lu.L.nnz == plain.lu.L.nnz
    right = np.random.default_rng(1).normal(size=K.shape[0])
    np.testing.assert_allclose(K @ plain.solve(right), right, atol=1e-8)
