"""A thick duct, of three thicknesses' radius, reduced, against each law on all degrees of freedom of its shell.

No sample, mode or constant was chosen on it: its bending, by the element of thick walls, is 9 times as stiff beside its
membrane as that of the ducts of the other tests.
"""

import numpy as np
import pytest

from tests.mechanics.reduction.hyperelastic.whole_shell import errors
from trocar.services.mechanics.fem import ElementChoice, ShellSection, clamp, pressure_load
from trocar.services.mechanics.reduction import DuctRecipe
from trocar.services.mechanics.reduction.membrane_laws import MEMBRANE_LAWS
from trocar.services.mechanics.reduction.membrane_laws.beyond_linear import BeyondLinear
from trocar.services.mechanics.reduction.recipe import ResidualChoice
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct

RADIUS, LENGTH, THICKNESS, E = 3e-3, 30e-3, 1e-3, 100e3


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
