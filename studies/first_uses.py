"""A scene's ordinary play, again and again in one process: what only the first play meets, a warm-up has missed."""

from __future__ import annotations

from pathlib import Path
from time import thread_time_ns

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.scene import SceneModel
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.mechanics.simulation.scene_catheter import place_catheter
from trocar.services.physics.warm_up import warm_up, warm_up_contact
from trocar.services.scenes import load_duct
from trocar.services.scenes.hands import hands_of
from trocar.services.scenes.ready import load_surface

TICK_S = 1e-3


class Plays:
    """A scene that is warmed up as physics does it, and then played by its own hands as often as one likes.

    Args:
        scene: SceneModel
        cache: Path. Of ducts that have been reduced before.
    """

    def __init__(self, scene: SceneModel, cache: Path) -> None:
        self._scene, self._duct = scene, load_duct(scene, cache, lambda stage, fraction: None)
        mesh = load_surface(scene, cache)
        self._hands, self._tools = hands_of(place_catheter(scene, mesh), mesh), ToolInputs()
        self._hands.write_inputs(0.0, self._tools)
        warm_up_contact(scene)
        warm_up(scene, self._duct)

    def play(self) -> FloatArray:
        """Play the scene once, from its start to its end, and return the processor times of its ticks in s."""
        simulation, tools, times_ns = Simulation(self._scene, self._duct), self._tools, []
        for tick in range(round(self._hands.duration_s / TICK_S)):
            self._hands.write_inputs((tick + 1) * TICK_S, tools)
            began_ns = thread_time_ns()
            simulation.step(tools, TICK_S)
            times_ns.append(thread_time_ns() - began_ns)
        return 1e-9 * np.array(times_ns)
