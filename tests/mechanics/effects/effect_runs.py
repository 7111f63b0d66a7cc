"""Short runs that tests of effects share."""

import numpy as np

from services.mechanics.scene.tools import ToolInputs
from services.mechanics.simulation import Simulation


def run(scene, duct, ticks=60, tools=None):
    simulation = Simulation(scene, duct)
    if tools is None:
        tools = ToolInputs()
        tools.present[:] = False
    for _ in range(ticks):
        simulation.step(tools)
    return simulation


def state(simulation):
    rod = simulation.catheter.state
    return np.concatenate([simulation.duct.state.q, rod.position_m.ravel(), rod.velocity_m_s.ravel()])


def pressing_tools(small_scene):
    tools = ToolInputs()
    tools.present[1] = False
    tools.position_m[0] = 20e-3, 0.0, 15e-3 + 3.5e-3
    return tools
