"""A curved duct that is inflated or pulled, reduced, against the same law on all degrees of freedom of its shell."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from trocar.services.mechanics.fem import ElementChoice, ShellSection, clamp, pressure_load
from trocar.services.mechanics.fem.factorisation import factorise
from trocar.services.mechanics.reduction import DuctRecipe, reduce_duct
from trocar.services.mechanics.reduction.free_dofs import free_load, nodal_translations
from trocar.services.mechanics.reduction.hyperelastic.energy_sampling import fetch_samples
from trocar.services.mechanics.reduction.hyperelastic.equilibrium import rest_shape
from trocar.services.mechanics.reduction.membrane_laws.beyond_linear import BeyondLinear
from trocar.services.mechanics.reduction.nonlinear.membrane import Membrane
from trocar.services.mechanics.reduction.recipe import ResidualChoice
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct

RADIUS, LENGTH, BEND, THICKNESS, E, EXPONENT = 4e-3, 40e-3, 60e-3, 0.5e-3, 100e3, 20.0
FUNG, FIBRES = BeyondLinear.of("fung", exponent=EXPONENT), BeyondLinear.of("fibres")


@pytest.fixture(scope="module")
def recipe():
    mesh = parametric_duct(DuctGeometry(RADIUS, LENGTH, n_around=24, n_along=24, curvature_1_m=1.0 / BEND))
    section, elements = ShellSection(THICKNESS, E, 0.45, 1060.0), ElementChoice("andes", "dkt")
    return DuctRecipe(mesh, section, (clamp(mesh),), 80, elements, ResidualChoice("none"), stretch_law=FUNG)


def strain_of_all(model, law):
    """The law's strain (3 m, f) per free degree of freedom, and each triangle's modulus times volume.

    Fung's takes y with y . y = e D e / E, that of the fibres the strain along the bent axis and round it.
    """
    membrane, n = Membrane.from_model(model), model.mesh.n_triangles
    corners = model.mesh.vertices_m[model.mesh.triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    energy_j = 0.5 * E * THICKNESS * np.linalg.norm(normal, axis=1)
    if law is FUNG:
        taken = np.linalg.cholesky(membrane.rigidity_n_m / energy_j[:, None, None]).transpose(0, 2, 1)
    else:
        taken = turned_to_axis(membrane.tangents, corners.mean(axis=1))
    # Strain ab of a triangle by its corner n along i: t_a,i dN_n / dx_b.
    mixed = np.einsum("mai,mbn->mabni", membrane.tangents, membrane.gradients)
    strain = np.stack([mixed[:, 0, 0], mixed[:, 1, 1], mixed[:, 0, 1] + mixed[:, 1, 0]], axis=1)
    strain = np.einsum("mcd,mdni->mcni", taken, strain)
    rows = np.broadcast_to(np.arange(3 * n).reshape(n, 3, 1, 1), strain.shape)
    columns = np.broadcast_to(6 * model.mesh.triangles[:, None, :, None] + np.arange(3), strain.shape)
    full = sp.coo_array((strain.ravel(), (rows.ravel(), columns.ravel())), shape=(3 * n, model.n_dofs))
    return full.tocsc()[:, model.free_dofs].tocsr(), energy_j


def turned_to_axis(tangents, middle_m):
    """Matrices (m, 3, 3) that make strains along the bent axis of those in the triangles' frames (m, 2, 3)."""
    angle = np.arctan2(middle_m[:, 0], BEND - middle_m[:, 1])
    axis = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    c, s = np.moveaxis(np.einsum("mai,mi->am", tangents, axis), 0, 0)
    size = np.hypot(c, s)
    c, s = c / size, s / size
    rows = [c * c, s * s, c * s], [s * s, c * c, -c * s], [-2.0 * c * s, 2.0 * c * s, c * c - s * s]
    return np.stack([np.stack(row, axis=1) for row in rows], axis=1)


def at_rest(model, law, load):
    """Displacement (n, 3) at rest of all degrees of freedom, by Newton's method in steps of the load."""
    B, energy_j = strain_of_all(model, law)
    K, whole = model.K_free, free_load(model, load)
    u = np.zeros(len(whole))
    for part in np.linspace(1.0 / 12.0, 1.0, 12):
        for _ in range(50):
            _, stress, tangent = law.respond((B @ u).reshape(-1, 3))
            left = part * whole - K @ u - B.T @ (energy_j[:, None] * stress).ravel()
            if np.linalg.norm(left) < 1e-7 * np.linalg.norm(whole):
                break
            stiff = sp.block_diag([sp.coo_array(each) for each in energy_j[:, None, None] * tangent], format="csr")
            u = u + factorise((K + B.T @ stiff @ B).tocsc()).solve(left)
        else:
            raise AssertionError("no equilibrium")
    return nodal_translations(model, u)


def errors(recipe, law, load, cache_dir):
    """Of the displacement, and of the work of the load, over those of all degrees of freedom."""
    recipe = replace(recipe, stretch_law=law)
    duct, model = reduce_duct(recipe, 0.1, cache_dir), recipe.model()
    basis, samples = duct.basis, fetch_samples(recipe, duct.basis, law, cache_dir)
    modal = np.einsum("nar,na->r", basis.Phi, load)
    left_out = model.solve_static(load).displacement_m - basis.displacements(modal / basis.omega_rad_s**2)
    q = rest_shape(samples.strain, samples.energy_j, law, basis.omega_rad_s, modal)
    moved, expected = basis.displacements(q) + left_out, at_rest(model, law, load)
    error = np.linalg.norm(moved - expected) / np.linalg.norm(expected)
    work = np.sum(load * moved) / np.sum(load * expected) - 1.0
    print(f"{basis.n_modes} modes: displacement {100.0 * error:.2f} %, work {100.0 * work:+.2f} %")
    return error, abs(work)


@pytest.mark.parametrize("strain", [0.1, 0.2])
def test_a_curved_duct_is_inflated_as_all_of_its_shell_is(recipe, cache_dir, strain):
    """What the modes of an even pressure leave out, more stretch within the bend than beyond it, is among the modes."""
    load = pressure_load(recipe.mesh, E * THICKNESS / RADIUS * strain * np.exp(EXPONENT * strain**2))
    assert max(errors(recipe, FUNG, load, cache_dir)) < 0.02


@pytest.mark.parametrize("strain", [0.1, 0.2])
def test_a_curved_duct_with_fibres_is_inflated_as_all_of_its_shell_is(recipe, cache_dir, strain):
    """Its modes are those of its own law: with those of Fung's, displacements are 4 and 8 % off."""
    load = pressure_load(recipe.mesh, E * THICKNESS / RADIUS * strain)
    assert max(errors(recipe, FIBRES, load, cache_dir)) < 0.025


def test_a_curved_duct_with_fibres_is_pulled_and_bent_as_all_of_its_shell_is(recipe, cache_dir):
    """A pull and a sideways force at its mouth: neither was solved for its modes."""
    mouth, force = recipe.mesh.vertex_sets["mouth"], np.zeros((recipe.mesh.n_vertices, 3))
    force[mouth] = 2.0 * np.pi * RADIUS * THICKNESS * E / len(mouth) * np.array([0.1, 0.01, 0.0])
    assert max(errors(recipe, FIBRES, force, cache_dir)) < 0.025
