"""docs/how-to/recipes.md, "Adding a contact law": one row, and an effect that puts rows under it."""

from __future__ import annotations

import pytest

from tests.recipes.tree_copy import TreeCopy

pytestmark = pytest.mark.timeout(600)  # a changed copy of the tree compiles anew

# A catheter of 20 mm under the roof of the duct, in a weight that is a third of the pull on each particle. Penalty
# forces are held over the next step, so their spring is soft: the catheter's own step damps nothing.
HANGING = """
from dataclasses import replace
from trocar.services.mechanics.effects.gravity import GravitySettings
from trocar.services.mechanics.effects.sticky_wall import StickyWallSettings
from trocar.services.mechanics.scene import CatheterScene, ContactSettings, DuctScene, SceneModel
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.mechanics.simulation.scene_duct import build_scene_duct

duct = DuctScene(n_around=12, n_along=14, n_modes=30, thickness_m=1e-3, youngs_modulus_pa=300e3, membrane="cst")
catheter = CatheterScene(anchor="free", length_m=20e-3, n_segments=10, tip_position_m=(10e-3, 0.0, 2.6e-3))
scene = SceneModel(duct=duct, catheter=catheter)
tools = ToolInputs()
tools.present[:] = False
for strategy in ("implicit", "penalty"):
    settings = ContactSettings(model=strategy, penalty_stiffness_n_m=0.5, penalty_damping_n_s_m=1e-3)
    for effects in ({}, {"sticky_wall": StickyWallSettings(pull_n=1e-4)}):
        effects = {"gravity": GravitySettings(), **effects}
        simulation = Simulation(replace(scene, contact=settings, effects=effects), build_scene_duct(scene))
        for _ in range(100):
            simulation.step(tools)
        print(strategy, len(effects), simulation.catheter.state.position_m[:, 2].mean(), simulation.max_penetration_m)
"""


@pytest.fixture(scope="module")
def followed(tree_of_module: TreeCopy) -> TreeCopy:
    tree_of_module.follow("Adding a contact law")
    return tree_of_module


def test_one_row_makes_a_law(followed: TreeCopy) -> None:
    """It carries the catheter's weight under both strategies, where without it the catheter falls."""
    height_m, overlap_m = {}, {}
    for line in followed.python(HANGING).splitlines():
        strategy, n_effects, height, overlap = line.split()
        height_m[strategy, n_effects], overlap_m[strategy, n_effects] = float(height), float(overlap)
    for strategy in ("implicit", "penalty"):
        assert height_m[strategy, "1"] < -1e-3
        assert height_m[strategy, "2"] > 2.4e-3
    assert overlap_m["implicit", "2"] < 5e-6
    # A pull of p rests at a depth p / k where a spring is all that keeps surfaces apart.
    assert overlap_m["penalty", "2"] > 20e-6


def test_a_law_that_is_not_in_the_table_is_named(followed: TreeCopy) -> None:
    code = """
try:
    import trocar.services.mechanics.effects
except ValueError as error:
    print(error)
"""
    path = followed.root / "services/mechanics/contact/laws.py"
    good = path.read_text()
    path.write_text("".join(line for line in good.splitlines(keepends=True) if '"sticky"' not in line))
    try:
        sentence = "contact law 'sticky' is not in the table; known: unilateral, grip, film, seal, squeeze"
        assert sentence in followed.python(code)
    finally:
        path.write_text(good)
