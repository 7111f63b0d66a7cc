"""What an effect costs: the same scene with and without it, tick by tick in turns."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from time import perf_counter_ns

import numpy as np

from trocar.services.mechanics.effects import EFFECTS
from trocar.services.mechanics.reduction import ReducedDuct
from trocar.services.mechanics.scenarios import PlayedScene, insertion
from trocar.services.mechanics.scene import SceneModel
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation

START_TICK = 500  # the jaws close on the catheter
N_TICKS = 1300  # until it is 20 mm in


@dataclass(frozen=True, slots=True)
class EffectCost:
    """Of a step, in microseconds.

    Attributes:
        extra_us: Median of (step with the effect - step without it), tick by tick; negative where noise is larger.
        noise_us: The same between two simulations that are alike: what an idle effect shows.
        step_us: Median step without the effect.
    """

    extra_us: float
    noise_us: float
    step_us: float


def measure_effect(name: str, scene: SceneModel, build_duct: Callable[[SceneModel], ReducedDuct]) -> EffectCost:
    """Run the hands of the insertion in `scene` with and without an effect, both at once.

    Three simulations, one with and two without, take every tick one after the other, in an order that turns, so that
    what else the machine does meets all alike. An effect that the scene has keeps its settings, another takes its
    defaults.
    Raises ValueError: an effect that does not exist, or that this scene cannot have.
    """
    if name not in EFFECTS:
        raise ValueError(f"unknown effect '{name}'; known: {', '.join(EFFECTS)}")
    stays = {other: kept for other, kept in scene.effects.items() if other != name}
    bare = replace(scene, effects=stays)
    settings = scene.effects[name] if name in scene.effects else EFFECTS[name].kind.Settings()
    with_it = replace(scene, effects={**bare.effects, name: settings})
    simulations = [Simulation(each, build_duct(each)) for each in (with_it, bare, bare)]
    times_us = time_in_turns(simulations, insertion())
    return EffectCost(
        extra_us=float(np.median(times_us[0] - times_us[1])),
        noise_us=float(np.median(times_us[2] - times_us[1])),
        step_us=float(np.median(times_us[1])),
    )


def time_in_turns(
    simulations: list[Simulation], hands: PlayedScene
) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """Duration [us] of every tick (len(simulations), N_TICKS), past the start, of simulations in the same hands."""
    tools = ToolInputs()
    times_us = np.zeros((len(simulations), N_TICKS))
    for tick in range(START_TICK + N_TICKS):
        hands.write_inputs(1e-3 * tick, tools)
        for turn in range(len(simulations)):
            k = (tick + turn) % len(simulations)
            start_ns = perf_counter_ns()
            simulations[k].step(tools)
            if tick >= START_TICK:
                times_us[k, tick - START_TICK] = 1e-3 * (perf_counter_ns() - start_ns)
    return times_us
