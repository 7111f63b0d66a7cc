"""Where stones are leaves physics with each of its states."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.physics.conftest import SMALL
from trocar.protocol.bodies.haptics import tool_table
from trocar.services.files.cache_directory import cache_directory
from trocar.services.mechanics.effects.gallstones import GallstonesSettings
from trocar.services.mechanics.effects.gravity import GravitySettings
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.physics.outputs import Outputs
from trocar.services.scenes import load_duct, load_scene


def test_where_stones_are_is_told_with_every_state() -> None:
    """The scene of the scenario *stone* showed no stone: its place was on no wire and in no picture."""
    stones = GallstonesSettings(((20e-3, 0.0, 0.0), (10e-3, 0.0, 0.0)), (1e-3, 0.8e-3))
    scene = replace(load_scene(SMALL), effects={"gallstones": stones, "gravity": GravitySettings()})
    simulation, tools = Simulation(scene, load_duct(scene, cache_directory(), lambda *_: None)), ToolInputs()
    tools.present[:] = False
    outputs, nobody = Outputs(simulation, ""), tool_table(())
    before_m = outputs.state(0, nobody).stones_m.view()
    np.testing.assert_array_equal(before_m, stones.position_m)
    for _ in range(20):
        simulation.step(tools)
    placed_m = outputs.state(20, nobody).stones_m.view()
    np.testing.assert_array_equal(placed_m, simulation.effects["gallstones"].position_m)
    assert (before_m - placed_m)[:, 2].min() > 10e-6


def test_a_scene_without_stones_sends_none() -> None:
    scene = load_scene(SMALL)
    simulation = Simulation(scene, load_duct(scene, cache_directory(), lambda *_: None))
    assert Outputs(simulation, "").state(0, tool_table(())).stones_m.shape == (0, 3)
