"""docs/how-to/recipes.md, "Adding a tool": one file and one row, and everybody knows it."""

from __future__ import annotations

import pytest

from tests.recipes.tree_copy import TreeCopy

pytestmark = pytest.mark.timeout(600)  # a changed copy of the tree compiles anew

# What the rig gets, what physics has of it, what is drawn, and what its own hand does to the duct.
WITH_IT = """
from dataclasses import replace
from trocar.protocol.bodies import InstrumentState
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.mechanics.simulation.scene_duct import build_scene_duct
from trocar.services.runtime.config import config
from trocar.services.runtime.config.scene_requirements import scene_requirements
from trocar.services.scenes import load_scene
from trocar.services.scenes.hands import hands_of
from trocar.services.visualization.codec import decode_hello, encode_hello
from trocar.services.visualization.composer import Composer
from tests.memory_bus import MemoryBus, MemoryHub

scene = load_scene("palpation", ("duct.n_around=12", "duct.n_along=14", "duct.n_modes=20"))
duct = build_scene_duct(scene)
simulation, tools = Simulation(scene, duct), ToolInputs()
hands = hands_of(simulation.scene, duct.mesh)
for tick in range(700):
    hands.write_inputs(1e-3 * tick, tools)
    simulation.step(tools)
layout = Composer(MemoryBus(MemoryHub()), scene, "", duct, ())
shape = layout._shape(1, InstrumentState(name="right", position_m=(0, 0, 0)))
layout = decode_hello(encode_hello(replace(layout.layout, tools=(shape,))))
rig = scene_requirements("palpation").fitted(config.load_rig("stub"))
print([row.grasp is not None for row in rig.gateway.instruments])
print(len(simulation.grasps), float(simulation.tool_results.force_n[1] @ simulation.tool_results.force_n[1]) > 1e-6)
print(layout.tools[0] == shape, layout.tools[0].has_jaws, len(layout.tools[0].parts))
"""


def test_one_file_and_one_row_make_a_tool(tree: TreeCopy) -> None:
    tree.follow("Adding a tool")
    assert tree.python(WITH_IT).splitlines()[-3:] == ["[True, False]", "1 True", "True False 4"]
