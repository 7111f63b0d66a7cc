"""Short runs that tests of effects share."""

import numpy as np

from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation


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


PRESSED_M = (20e-3, 0.0, 15e-3 + 3.5e-3)


def come_down(simulation, at_m=PRESSED_M, ticks=80):
    """Let a tool come down from 4 mm above to where it presses the wall; return the tools as they are then."""
    tools = ToolInputs()
    tools.present[1] = False
    for tick in range(ticks + 1):
        tools.position_m[0] = np.add(at_m, (0.0, 0.0, 4e-3 * (1.0 - tick / ticks)))
        simulation.step(tools)
    return tools
