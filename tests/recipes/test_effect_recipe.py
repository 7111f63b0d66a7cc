"""docs/how-to/recipes.md, "Adding an effect": one file, one row, its name in a scene."""

from __future__ import annotations

import json

import pytest

from tests.recipes.tree_copy import TreeCopy

pytestmark = pytest.mark.timeout(600)  # a changed copy of the tree compiles anew

SMALL = """
import hashlib
import sys
import numpy as np
from trocar.services.mechanics.simulation import Simulation
from trocar.studies.energy_book import EnergyBook
from trocar.services.mechanics.simulation.scene_duct import build_scene_duct
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.scenes import load_scene

SMALL = ["duct.n_around=12", "duct.n_along=14", "duct.n_modes=30", "duct.thickness_m=1e-3", "duct.membrane=cst"]
"""

ALONE = (
    SMALL
    + """
scene = load_scene("stream", [*SMALL, "catheter.anchor=free", "catheter.tip_position_m=[60e-3, 40e-3, 0]",
                              "catheter.viscous_drag_n_s_m2=0"])
simulation, tools = Simulation(scene, build_scene_duct(scene)), ToolInputs()
tools.present[:] = False
book = EnergyBook(simulation)
for _ in range(100):
    book.step(tools)
rod = simulation.catheter
print(*(rod.properties.particle_mass_kg() @ rod.state.velocity_m_s), book.flow.imbalance_j,
      simulation.duct.state.q.any())
"""
)

WITHOUT = (
    SMALL
    + """
scene = load_scene("insertion", SMALL)
simulation, tools = Simulation(scene, build_scene_duct(scene)), ToolInputs()
tools.present[1] = False
state = hashlib.sha256()
for tick in range(100):
    tools.position_m[0] = 20e-3, 0.0, 20e-3 - 1e-4 * tick
    simulation.step(tools)
    state.update(simulation.duct.state.q.tobytes() + simulation.catheter.state.position_m.tobytes())
assert simulation.tool_results.force_n.any()
print(*simulation.effects, state.hexdigest())
"""
)


@pytest.fixture(scope="module")
def without_it(tree_of_module: TreeCopy) -> str:
    return tree_of_module.python(WITHOUT)


@pytest.fixture(scope="module")
def followed(tree_of_module: TreeCopy, without_it: str) -> TreeCopy:
    tree_of_module.follow("Adding an effect")
    return tree_of_module


def test_one_file_and_one_row_make_an_effect(followed: TreeCopy) -> None:
    """It pushes as its law says and the balance knows what it stores; the tree's own tests see nothing amiss."""
    *momentum, imbalance_j, duct_moved = followed.python(ALONE).split()
    assert [float(p) for p in momentum] == pytest.approx([0.0, 0.1 * 51 * 1e-4, 0.0], abs=1e-12)
    assert abs(float(imbalance_j)) < 1e-9
    assert duct_moved == "False"
    listed = json.loads((followed.root / "effects.json").read_text())["effects"]
    mine = next(line for line in listed if line["name"] == "current")
    assert mine["in_scene"]
    assert mine["stages"] == ["prepare", "add_loads"]
    assert mine["settings"] == {"force_n": [0.0, 1e-4, 0.0]}
    followed.pytest("tests/scenes/test_load.py", "tests/mechanics/effects/test_effects.py")


def test_without_its_name_in_the_scene_not_a_bit_changes(followed: TreeCopy, without_it: str) -> None:
    assert "current" not in without_it
    assert followed.python(WITHOUT) == without_it


def test_its_settings_are_checked_with_the_path_of_the_key(followed: TreeCopy) -> None:
    reasons = {
        "force_n=[0, 0]": "effects.current.force_n.2: this key is missing",
        "force_n=strong": "effects.current.force_n: input should be a valid array",
        "force=1": "effects.current.force: unknown key 'force'; known: force_n; did you mean 'force_n'?",
    }
    told = followed.python(f"""
from trocar.services.runtime.errors import ConfigError
from trocar.services.scenes import load_scene
for option in {list(reasons)}:
    try:
        load_scene("stream", ["effects.current." + option])
    except ConfigError as error:
        print(error)
""").splitlines()
    assert told == [f"--set effects.current.{option}: {reason}" for option, reason in reasons.items()]
