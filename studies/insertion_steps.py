"""The insertion with other settings or lengths of the tick: what the hands feel and where the catheter goes."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.scenarios import insertion
from trocar.services.mechanics.scene import SceneModel
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.mechanics.simulation.scene_duct import build_scene_duct

_EVERY_S = 1e-3


class Inserted(NamedTuple):
    """What a run tells, once a millisecond.

    Attributes:
        force_n: (k, 2, 3) float64. On both tools.
        tip_m: (k, 3) float64. Of the catheter.
        length_m: float. Inserted at the end.
        wall_m: (n, 3) float64. Nodes of the duct at the end.
    """

    force_n: FloatArray
    tip_m: FloatArray
    length_m: float
    wall_m: FloatArray


def insert(dt_s: float, cache_dir: Path, scene: SceneModel | None = None, duration_s: float | None = None) -> Inserted:
    """Run the scripted insertion in ticks of ``dt_s``, a whole fraction of a millisecond.

    ``scene`` takes the place of the scenario's own; the hands are the same. They stop after ``duration_s``.
    """
    scenario = insertion()
    scene = scene or scenario.scene
    simulation, tools = Simulation(scene, build_scene_duct(scene, cache_dir)), ToolInputs()
    per_sample, count = round(_EVERY_S / dt_s), round((duration_s or scenario.duration_s) / _EVERY_S)
    force_n, tip_m = np.empty((count, 2, 3)), np.empty((count, 3))
    for tick in range(count * per_sample):
        scenario.write_inputs((tick + 1) * dt_s, tools)
        simulation.step(tools, dt_s)
        force_n[tick // per_sample] = simulation.tool_results.force_n
        tip_m[tick // per_sample] = simulation.catheter.state.position_m[-1]
    return Inserted(force_n, tip_m, simulation.inserted_length_m, simulation.duct.surface_m())


def rms(vectors: FloatArray) -> float:
    """Root mean square of the lengths of (..., 3) vectors."""
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=-1))))
