"""A law of the membrane is one file and one row: the tests of all laws find it, and a wall obeys it."""

from __future__ import annotations

import pytest

from tests.recipes.tree_copy import TreeCopy

pytestmark = pytest.mark.timeout(600)  # a changed copy of the tree compiles anew

WALL = """
from pathlib import Path
from trocar.services.mechanics.effects.hyperelasticity import HyperelasticitySettings
from trocar.services.mechanics.reduction.hyperelastic.energy_sampling import fetch_samples
from trocar.services.scenes import load_duct, load_scene
small = ["duct.n_around=12", "duct.n_along=10", "duct.n_modes=20", "duct.residual=none"]
scene = load_scene("my-insertion", small)
settings = scene.effects["hyperelasticity"]
duct = load_duct(scene, Path("cache"), lambda stage, fraction: None)
samples = fetch_samples(duct.recipe, duct.basis, settings.beyond_linear(), Path("cache"))
print(settings.law, *samples.law.parameters, len(samples.energy_j))
"""


def test_a_law_is_one_file_and_one_row(tree: TreeCopy) -> None:
    """The recipe runs the tests of all laws and of all terms; here a wall is sampled for it."""
    tree.follow("Adding a law of the membrane")
    name, steepness, n_samples = tree.python(WALL).split()
    assert (name, float(steepness)) == ("demiray", 2.0)
    assert 20 < int(n_samples) <= 160
