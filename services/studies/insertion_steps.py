"""The insertion at several lengths of the tick: how far its forces are from those at a much shorter one."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from services.mechanics.arrays import FloatArray
from services.mechanics.scenarios import insertion
from services.mechanics.scene.tools import ToolInputs
from services.mechanics.simulation import Simulation
from services.mechanics.simulation.scene_duct import build_scene_duct

_EVERY_S = 1e-3


class Inserted(NamedTuple):
    """What a run tells, once a millisecond.

    Attributes
    ----------
    force_n : (k, 2, 3) float64
        On both tools.
    tip_m : (k, 3) float64
        Of the catheter.
    length_m : float
        Inserted at the end.
    """

    force_n: FloatArray
    tip_m: FloatArray
    length_m: float


def insert(dt_s: float, cache_dir: Path) -> Inserted:
    """Run the scripted insertion in ticks of ``dt_s``, a whole fraction of a millisecond."""
    scenario = insertion()
    simulation, tools = Simulation(scenario.scene, build_scene_duct(scenario.scene, cache_dir)), ToolInputs()
    per_sample, count = round(_EVERY_S / dt_s), round(scenario.duration_s / _EVERY_S)
    force_n, tip_m = np.empty((count, 2, 3)), np.empty((count, 3))
    for tick in range(count * per_sample):
        scenario.write_inputs((tick + 1) * dt_s, tools)
        simulation.step(tools, None, dt_s)
        force_n[tick // per_sample] = simulation.tool_results.force_n
        tip_m[tick // per_sample] = simulation.catheter.state.position_m[-1]
    return Inserted(force_n, tip_m, simulation.inserted_length_m)


def rms(vectors: FloatArray) -> float:
    """Root mean square of the lengths of (..., 3) vectors."""
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=-1))))
