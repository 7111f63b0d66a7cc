"""Compiles every kernel of a scene before the loop begins: the first contact must not cost a second."""

from __future__ import annotations

import numpy as np

from services.mechanics.contact.pairs import CATHETER_SEGMENT, ContactPairs
from services.mechanics.reduction.duct import ReducedDuct
from services.mechanics.scene import SceneModel
from services.mechanics.simulation import Simulation
from services.mechanics.tools import GraspHold, ToolInputs

_STEPS = 20


def warm_up(scene: SceneModel, duct: ReducedDuct) -> None:
    """Run a throw-away simulation with a tool in the wall, a tool that holds the catheter, and pairs from outside."""
    simulation = Simulation(scene, duct)
    tools = ToolInputs()
    middle = duct.mesh.n_vertices // 2
    tools.position_m[0] = duct.mesh.vertices_m[middle]
    tools.position_m[1] = simulation.catheter.state.position_m[-2]
    tools.jaw_angle_rad[:] = 0.3
    for _ in range(_STEPS):
        simulation.step(tools)
    pairs = ContactPairs.allocate(scene.contact.capacity)
    last_segment = simulation.catheter.state.position_m.shape[0] - 2
    tools.holds = [GraspHold(0, 1, CATHETER_SEGMENT, last_segment, np.array([0.5, 0.5, 0.0]), 1.0, 0.2)]
    for _ in range(_STEPS):
        simulation.step(tools, pairs)
