"""A shut jaw pressed on the wall, held there: what sticks does not creep, and its force does not fade, at any tick."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.studies.stability.drive import Driven, reduced_duct
from trocar.studies.stability.family import Case, Draw
from trocar.studies.stability.hands import HandMotions, least_jerk
from trocar.studies.stability.situations import beside
from trocar.studies.stability.strokes import at_step

STEPS_MS = 1.0, 0.25, 0.1
WATCHED_S = {1.0: 5.0, 0.25: 2.0, 0.1: 1.0}
SETTLED_S = 1.0
COUNT = 4


def cases(draw: Draw) -> Iterator[Case]:
    """Pressed on by 0.5 to 2 mm and dragged along by less than what breaks it away, at 1, 0.25 and 0.1 ms."""
    for step in STEPS_MS if draw.is_long else (1.0,):
        for k in range(COUNT if draw.is_long else 1):
            name = f"{step:g} ms, number {k}"
            watched_s = WATCHED_S[step] if draw.is_long else 0.5
            yield Case(name, partial(_held, draw, name, 1e-3 * step, watched_s))


def _held(draw: Draw, name: str, dt_s: float, watched_s: float) -> Driven:
    scene, hands = beside().scene, at_step(_pressing(draw.random(f"tool on wall {name}")), dt_s)
    simulation, tools = Simulation(scene, reduced_duct(scene)), ToolInputs()
    for step in range(len(hands)):
        hands.write(step, tools)
        simulation.step(tools, dt_s)
    _stay(simulation, tools, dt_s, SETTLED_S)
    before_m, before_n = simulation.duct.surface_m(), simulation.tool_results.force_n[1].copy()
    _stay(simulation, tools, dt_s, watched_s)
    crept_m = float(np.linalg.norm(simulation.duct.surface_m() - before_m, axis=1).max())
    faded = float(np.linalg.norm(simulation.tool_results.force_n[1] - before_n) / np.linalg.norm(before_n))
    minute = 60.0 / watched_s
    steps = len(hands) + round((SETTLED_S + watched_s) / dt_s)
    return Driven({"creep": minute * crept_m, "relaxation": minute * faded}, repr(before_n), steps)


def _pressing(random: np.random.Generator) -> HandMotions:
    """Tool 1 shut, from beside the duct onto it, and along it by a little."""
    hands = beside().hands
    down = least_jerk(8e-3 + random.uniform(0.5e-3, 2e-3), np.array([0.0, 0.0, -1.0]), 50e-3)
    along = random.normal(size=3) * (1.0, 1.0, 0.0)
    aside = down[-1] + least_jerk(random.uniform(0.05e-3, 0.2e-3), along / np.linalg.norm(along), 5e-3)
    way = np.concatenate([down, aside])
    hands = hands.then(len(way)).moved(1, way, len(hands)).with_jaws(1, np.zeros(len(hands) + len(way)), 0)
    present = hands.present.copy()
    present[:, 0] = False
    return replace(hands, present=present)


def _stay(simulation: Simulation, tools: ToolInputs, dt_s: float, time_s: float) -> None:
    for _ in range(round(time_s / dt_s)):
        simulation.step(tools, dt_s)
