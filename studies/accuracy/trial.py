"""Trials of a scene with its own hands: what is felt and seen, how far that is off, and what a tick costs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.reduction import ReducedDuct
from trocar.services.mechanics.scene import SceneModel
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.scenes.hands import hands_of
from trocar.studies.accuracy.costs import measure_costs
from trocar.studies.accuracy.insertions import TICK_S, in_steps
from trocar.studies.accuracy.study import Cost, Tick
from trocar.studies.insertion_steps import rms

BuildDuct = Callable[[SceneModel], ReducedDuct]
HELD_AT = 0.73
"""Share of what the hands do after which they hold still, while ticks are timed: most of it is done by then."""
SAMPLES = 150
STILL_TIP_M, STILL_WALL = 1e-6, 1e-8
"""What moves by less lies still: a micrometre, and as much of a wall of 0.1 g, in m sqrt(kg)."""


@dataclass(frozen=True, slots=True)
class Run:
    """What the hands feel and the eye sees, once a millisecond.

    Attributes:
        force_n: (k, 2, 4) float64. On both tools, and what their jaws press apart with at their tips: a pinch is hardly
            felt by anything else.
        tip_m: (k, 3) float64. Way of the catheter's tip from where it began.
        wall: (k,) float64. Norm of the modal coordinates: the wall's root mean square displacement, weighted by its
            mass, on any mesh.
    """

    force_n: FloatArray
    tip_m: FloatArray
    wall: FloatArray


@dataclass(frozen=True, slots=True)
class Errors:
    """Root mean square differences over a run, in per cent of the reference; of motion the larger of tip and wall."""

    force_percent: float
    motion_percent: float

    @property
    def worst_percent(self) -> float:
        """The larger one."""
        return max(self.force_percent, self.motion_percent)


class TrialBench(Protocol):
    """Where scenes are tried."""

    def run(self, scene: SceneModel, dt_s: float = TICK_S, level: int = 0) -> Run:
        """Return what comes of a scene's own hands."""

    def costs(self, scenes: Sequence[tuple[SceneModel, int]]) -> list[Cost]:
        """Return what a tick costs of each scene and quality level, measured in turns."""


class Trial:
    """Runs scenes on this machine."""

    def __init__(self, build_duct: BuildDuct) -> None:
        self._build_duct = build_duct

    def run(self, scene: SceneModel, dt_s: float = TICK_S, level: int = 0) -> Run:
        """Return what comes of a scene's own hands in steps of ``dt_s``, a whole part of a millisecond.

        On a rung whose steps are several times as long, what a step led to is felt until the next.
        """
        simulation, hands, tools = self._begin(scene, level)
        per_sample, n = round(TICK_S / dt_s), round(hands.duration_s / TICK_S)
        per_step = scene.quality[level].ticks_per_step
        run = Run(np.empty((n, 2, 4)), np.empty((n, 3)), np.empty(n))
        jaw_m = [tool.jaws.jaw_length_m if tool.jaws else np.inf for tool in simulation.tools.forceps]
        start_m = simulation.catheter.state.position_m[-1].copy()
        for tick in range(n * per_sample):
            if (tick + 1) % per_step == 0:
                hands.write_inputs((tick + 1) * dt_s, tools)
                simulation.step(tools, per_step * dt_s)
            at = tick // per_sample
            run.force_n[at, :, :3] = simulation.tool_results.force_n
            run.force_n[at, :, 3] = simulation.tool_results.grasp_torque_nm / jaw_m
            run.tip_m[at] = simulation.catheter.state.position_m[-1] - start_m
            run.wall[at] = np.linalg.norm(simulation.duct.state.q)
        return run

    def costs(self, scenes: Sequence[tuple[SceneModel, int]]) -> list[Cost]:
        """Return what a tick costs in the middle of what the hands do: of a step over several, its part."""
        costs = measure_costs({str(k): self.tick(*each) for k, each in enumerate(scenes)}, SAMPLES)
        return [costs[str(k)].shared(scene.quality[level].ticks_per_step) for k, (scene, level) in enumerate(scenes)]

    def tick(self, scene: SceneModel, level: int = 0, dt_s: float = TICK_S) -> Tick:
        """Return a millisecond of a scene in steps of ``dt_s``, most of what its hands do being done.

        On a rung whose steps are several times as long, it is that many milliseconds.
        """
        simulation, hands, tools = self._begin(scene, level)
        for tick in range(round(HELD_AT * hands.duration_s / TICK_S)):
            hands.write_inputs((tick + 1) * TICK_S, tools)
            simulation.step(tools, TICK_S)
        return in_steps(simulation, tools, dt_s, scene.quality[level].ticks_per_step)

    def _begin(self, scene: SceneModel, level: int) -> tuple[Simulation, Any, ToolInputs]:
        duct = self._build_duct(scene)
        simulation = Simulation(scene, duct)
        simulation.set_quality(level)
        return simulation, hands_of(simulation.scene, duct.mesh), ToolInputs()


def errors_of(run: Run, reference: Run) -> Errors:
    """Return how far a run is off; nothing felt, and nothing moved, in the reference is no error."""
    tip = percent(run.tip_m, reference.tip_m) if _has_moved(run.tip_m, reference.tip_m, STILL_TIP_M) else 0.0
    wall = percent(run.wall, reference.wall) if _has_moved(run.wall, reference.wall, STILL_WALL) else 0.0
    return Errors(percent(run.force_n, reference.force_n), max(tip, wall))


def _has_moved(values: FloatArray, reference: FloatArray, still: float) -> bool:
    """Return whether either moved by more than what counts as still: the rest is rounding."""
    return bool(max(np.abs(values).max(), np.abs(reference).max()) > still)


def percent(values: FloatArray, reference: FloatArray) -> float:
    """Return the root mean square difference of vectors (k, n) in per cent of that of the reference, 0 of nothing."""
    largest = rms(reference)
    return 100.0 * rms(values - reference) / largest if largest else 0.0
