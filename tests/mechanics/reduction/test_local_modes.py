"""Modes beside supports: modes of the same wall, and what they hold there of what a force moves it by."""

from dataclasses import replace

import numpy as np
import pytest

from trocar.services.mechanics.fem import ElementChoice, ShellSection, clamp
from trocar.services.mechanics.reduction import DuctRecipe, reduce_duct
from trocar.services.mechanics.reduction.recipe import ResidualChoice
from trocar.services.mechanics.reduction.softening.training import own_compliance_m_n
from trocar.services.mechanics.surface.mesh import vertex_normals
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct

LENGTH_M, RADIUS_M, N_MODES = 30e-3, 4e-3, 60


def recipe_of(n_local, around=16, along=16, kind="auto"):
    mesh = parametric_duct(DuctGeometry(RADIUS_M, LENGTH_M, around, along))
    section = ShellSection(0.5e-3, 100e3, 0.45, 1060.0)
    choice = ResidualChoice(kind=kind)
    return DuctRecipe(mesh, section, (clamp(mesh),), N_MODES, ElementChoice("andes", "dkt"), choice, n_local)


@pytest.fixture(scope="module")
def duct(cache_dir):
    return reduce_duct(recipe_of(12), 0.1, cache_dir)


def share_of_modes(duct):
    """(n,) part of each free node's compliance, radially, that the modes hold; with how far it is from the clamp."""
    out = vertex_normals(duct.mesh)
    own = np.einsum("na,nab,nb->n", out, own_compliance_m_n(duct), out)
    modal = np.sum((np.einsum("nar,na->nr", duct.basis.Phi, out) / duct.basis.omega_rad_s) ** 2, axis=1)
    free = own > 0.0
    return modal[free] / own[free], duct.mesh.vertices_m[free, 0]


def test_they_are_orthogonal_to_all_others_by_mass_and_faster(duct):
    basis, mass_kg = duct.basis, duct.recipe.model().mass_kg
    product = np.einsum("nar,n,nas->rs", basis.Phi, mass_kg, basis.Phi, optimize=True)
    np.testing.assert_allclose(product, np.eye(basis.n_modes), atol=1e-8)
    assert 11 <= duct.n_local_modes <= 12
    assert basis.n_modes <= N_MODES + 12
    assert np.all(np.diff(basis.omega_rad_s) > -1e-6 * basis.omega_rad_s[1:])


def test_they_are_orthogonal_by_stiffness(duct):
    """The rotations of a mode follow from its translations: the energy of a sum is the sum of the energies."""
    basis, model = duct.basis, duct.recipe.model()
    t = model.free_translations
    shapes = np.zeros((model.n_dofs, basis.n_modes))
    shapes.reshape(-1, 6, basis.n_modes)[:, :3] = basis.Phi
    condensed = np.linalg.inv(unit_responses(model, t))
    translations = shapes[model.free_dofs][t]
    product = translations.T @ condensed @ translations
    np.testing.assert_allclose(product, np.diag(basis.omega_rad_s**2), atol=1e-6 * basis.omega_rad_s[-1] ** 2)


def unit_responses(model, t):
    loads = np.zeros((len(model.free_dofs), len(t)))
    loads[t, np.arange(len(t))] = 1.0
    return model.factor.solve(loads)[t]


def test_all_together_is_as_exact_as_before(duct):
    """Modes and residual are the full model's compliance, on the first row beside the clamp as elsewhere."""
    model, own = duct.recipe.model(), own_compliance_m_n(duct)
    for node in (20, 40, 150, 260):
        load = np.zeros((duct.mesh.n_vertices, 3))
        load[node] = (0.3, -0.5, 0.8)
        moved = model.solve_static(load).displacement_m[node]
        np.testing.assert_allclose(own[node] @ load[node], moved, rtol=2e-6, atol=1e-6 * np.abs(moved).max())


def test_they_hold_most_of_what_a_force_beside_the_clamp_does(duct, cache_dir):
    """A third of it is held without them; that they hold it elsewhere is not asked."""
    without, x = share_of_modes(reduce_duct(recipe_of(0), 0.1, cache_dir))
    share, _ = share_of_modes(duct)
    first_row = x < 1.5 * LENGTH_M / 16
    assert without[first_row].mean() < 0.4
    assert share[first_row].mean() > 0.75
    assert share[first_row].min() > 0.6
    assert np.all(share < 1.0 + 1e-6)


def test_they_are_damped_critically_and_others_as_they_were(duct):
    np.testing.assert_array_equal(duct.damping_ratio[: -duct.n_local_modes], 0.1)
    np.testing.assert_array_equal(duct.damping_ratio[-duct.n_local_modes :], 1.0)


def test_without_them_a_wall_is_known_by_the_same_name():
    recipe = recipe_of(0)
    assert recipe.key() == replace(recipe, n_local_modes=0).key()
    assert recipe.key() != replace(recipe, n_local_modes=12).key()


@pytest.mark.parametrize("n_modes", [47, 48, 49, 50])
def test_a_symmetric_wall_keeps_symmetric_modes(cache_dir, n_modes):
    """A pair is taken whole or not at all: one sector's residual is then that of all, see `residual.cyclic`."""
    full, cyclic = (
        reduce_duct(replace(recipe_of(11, 12, 10, kind), n_modes=n_modes), 0.1, cache_dir)
        for kind in ("full", "cyclic")
    )
    own = own_compliance_m_n(full)
    np.testing.assert_allclose(own_compliance_m_n(cyclic), own, rtol=0.0, atol=1e-6 * own.max())
    assert cyclic.residual.store.odd.shape[2] == 0
