"""The situation that most studies share: the scripted insertion, and a tick in the middle of it."""

from __future__ import annotations

from trocar.services.files.cache_directory import cache_directory
from trocar.services.mechanics.scenarios import insertion
from trocar.services.mechanics.scene import SceneModel
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.mechanics.simulation.scene_duct import build_scene_duct
from trocar.studies.accuracy.study import Draw, Error, Reference, Tick
from trocar.studies.insertion_steps import insert, rms

FORCE, TIP, DEPTH = "force over an insertion", "tip over an insertion", "insertion depth"
TICK_S = 1e-3
SLIDING_S = 1.6
"""Both jaws hold, and 17 mm of catheter lie in the duct: about 30 contacts."""
_SHORT_S = 0.7


def insertion_reference(scene: SceneModel, draw: Draw, dt_s: float = TICK_S) -> Reference:
    """Return what an insertion is compared with."""
    run = insert(dt_s, cache_directory() / "bases", scene, duration_s(draw))
    return {"force_n": run.force_n, "tip_m": run.tip_m}


def insertion_errors(scene: SceneModel, reference: Reference, draw: Draw, dt_s: float = TICK_S) -> dict[str, Error]:
    """Return how far the forces on both tools and the tip are from the reference, root mean square over the run.

    Depth is the tip's way along the duct at the end, which counts a tip that stays outside too.
    """
    run = insert(dt_s, cache_directory() / "bases", scene, duration_s(draw))
    force, tip = reference["force_n"], reference["tip_m"]
    return {
        FORCE: Error(100.0 * rms(run.force_n - force) / rms(force), "%"),
        TIP: Error(1e3 * rms(run.tip_m - tip), "mm"),
        DEPTH: Error(1e3 * abs(float(run.tip_m[-1, 0] - tip[-1, 0])), "mm"),
    }


def duration_s(draw: Draw) -> float:
    """Return how long the hands move."""
    return draw.pick(_SHORT_S, insertion().duration_s, insertion().duration_s)


def insertion_tick(scene: SceneModel, draw: Draw, dt_s: float = TICK_S) -> Tick:
    """Return a millisecond of the insertion, from the moment at which most of it lies in the duct, hands held still."""
    hands, tools = insertion(), ToolInputs()
    simulation = Simulation(scene, build_scene_duct(scene, cache_directory() / "bases"))
    for tick in range(round(draw.pick(_SHORT_S, SLIDING_S, SLIDING_S) / TICK_S)):
        hands.write_inputs((tick + 1) * TICK_S, tools)
        simulation.step(tools, TICK_S)
    return in_steps(simulation, tools, dt_s)


def in_steps(simulation: Simulation, tools: ToolInputs, dt_s: float, times: int = 1) -> Tick:
    """Return so many milliseconds of a simulation, hands held still, in as many steps as one has of ``dt_s``."""
    per_tick = max(1, round(TICK_S / dt_s))

    def tick() -> None:
        for _ in range(per_tick):
            simulation.step(tools, times * dt_s)

    return tick
