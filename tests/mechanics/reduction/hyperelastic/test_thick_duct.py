"""A thick duct, of three thicknesses' radius, reduced, against each law on all degrees of freedom of its shell.

Where it relaxes, the judge is the hereditary integral of the law's force, in steps of a twentieth.

No sample, mode or constant was chosen on it: its bending, by the element of thick walls, is 9 times as stiff beside its
membrane as that of the ducts of the other tests.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from tests.mechanics.reduction.hyperelastic.whole_shell import errors
from trocar.services.mechanics.fem import ElementChoice, ShellSection, clamp, pressure_load
from trocar.services.mechanics.reduction import DuctRecipe, reduce_duct
from trocar.services.mechanics.reduction.hyperelastic.energy_sampling import fetch_samples
from trocar.services.mechanics.reduction.hyperelastic.equilibrium import rest_shape
from trocar.services.mechanics.reduction.membrane_laws import MEMBRANE_LAWS
from trocar.services.mechanics.reduction.membrane_laws.beyond_linear import BeyondLinear
from trocar.services.mechanics.reduction.recipe import ResidualChoice
from trocar.services.mechanics.reduction.viscoelastic import PronySeries, ViscousModes
from trocar.services.mechanics.reduction.wall_step.implicit_step import WallStep, relax_wall, wall_force
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct

RADIUS, LENGTH, THICKNESS, E = 3e-3, 30e-3, 1e-3, 100e3
SERIES, DT_S = PronySeries((0.2, 0.15, 0.1), (0.1, 1.0, 10.0)), 1e-3


@pytest.fixture(scope="module")
def recipe():
    mesh = parametric_duct(DuctGeometry(RADIUS, LENGTH, n_around=24, n_along=24))
    section, elements = ShellSection(THICKNESS, E, 0.45, 1060.0), ElementChoice("andes", "reissner")
    return DuctRecipe(mesh, section, (clamp(mesh),), 80, elements, ResidualChoice("none"))


@pytest.mark.parametrize("name", MEMBRANE_LAWS)
def test_a_thick_duct_is_inflated_as_all_of_its_shell_is(recipe, cache_dir, name):
    """By a pressure that stretches a linear wall by 0.1 round it."""
    load = pressure_load(recipe.mesh, 0.1 * E * THICKNESS / RADIUS)
    assert max(errors(recipe, BeyondLinear.of(name), load, cache_dir)) < 0.02


@pytest.mark.parametrize("name", MEMBRANE_LAWS)
def test_a_thick_duct_is_pulled_and_bent_as_all_of_its_shell_is(recipe, cache_dir, name):
    """By a pull that stretches a linear wall by 0.1, and a tenth of it sideways, at its mouth."""
    mouth, force = recipe.mesh.vertex_sets["mouth"], np.zeros((recipe.mesh.n_vertices, 3))
    force[mouth] = 2.0 * np.pi * RADIUS * THICKNESS * E / len(mouth) * np.array([0.1, 0.01, 0.0])
    assert max(errors(recipe, BeyondLinear.of(name), force, cache_dir)) < 0.025


@pytest.mark.parametrize("name", MEMBRANE_LAWS)
def test_a_thick_duct_that_is_inflated_again_and_again_loses_what_its_series_says(recipe, cache_dir, name):
    """Work of each of three cycles of a second against that of the hereditary integral; it never gives any."""
    law = BeyondLinear.of(name)
    recipe = replace(recipe, stretch_law=law)
    basis = reduce_duct(recipe, 0.1, cache_dir).basis
    samples, omega = fetch_samples(recipe, basis, law, cache_dir), basis.omega_rad_s
    load = np.einsum("nar,na->r", basis.Phi, pressure_load(recipe.mesh, 0.1 * E * THICKNESS / RADIUS))
    q = rest_shape(samples.strain, samples.energy_j, law, omega, load)

    def elastic(share):
        stretch = (samples.strain @ q).reshape(-1, 3)
        stress = law.respond(share * stretch)[1]
        return share * np.sum((omega * q) ** 2) + samples.energy_j @ np.sum(stress * stretch, axis=1)

    def works(shares, forces):
        return np.sum((0.5 * (forces[1:] + forces[:-1]) * np.diff(shares)).reshape(3, -1), axis=1)

    def shares(n):
        return 0.5 * (1.0 - np.cos(2.0 * np.pi * np.linspace(0.0, 3.0, 3 * n + 1)))

    wall, viscous, forces, last = WallStep.of(omega**2, samples, None, SERIES), ViscousModes(omega, SERIES), [0.0], 0.0
    wall.take_gain(1.0 / omega**2)
    decay = np.exp(-DT_S / np.array(SERIES.tau_s))
    for share in shares(round(1.0 / DT_S))[1:]:
        relax_wall(wall.address, last * q, share * q, decay)
        viscous.relax(share * q, DT_S)
        wall_force(wall.address, share * q, borne := np.zeros(len(q)))
        forces.append((omega**2 * share * q - borne - viscous.force() - wall.lagging) @ q)
        last = share
    n = round(20.0 / DT_S)
    fine, lag, exact = shares(n), np.zeros(3), [0.0]
    there = [elastic(share) for share in fine[: n // 2 + 1]]  # and back, three times, through the same
    at_once = [*3 * [*there, *there[-2:0:-1]], there[0]]
    factor = np.exp(-DT_S / 20.0 / np.array(SERIES.tau_s))
    for before, after in pairwise(at_once):
        lag = 0.5 * (before + after) + factor * (lag - 0.5 * (before + after))
        exact.append(after - np.array(SERIES.g) @ lag)
    lost, expected = works(shares(round(1.0 / DT_S)), np.array(forces)), works(fine, np.array(exact))
    assert (lost > 0.0).all()
    # What lags follows the end of a step: half a step of the shortest time early.
    np.testing.assert_allclose(lost, expected, rtol=0.5 * DT_S / min(SERIES.tau_s))
