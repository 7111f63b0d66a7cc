"""An insertion whose models come late: what both hands feel, beside what the mechanics solve for where they are.

The hands of the scenario go their way whatever they feel, so that every row is the same insertion. A model of a tick is
at the servo in the next one if nothing is added; a servo that has only a force holds the newest that came.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from trocar.protocol.bodies.haptics import MODEL_COLUMNS, MODEL_CONTACT, MODEL_F0, MODEL_K, MODEL_X0
from trocar.protocol.topics import TICK_S
from trocar.services.gateway.servo.servo_arrays import MEMORY_FORCE, MEMORY_SIZE, NOW_AGE
from trocar.services.gateway.servo.servo_law import servo_force
from trocar.services.mechanics.arrays import FloatArray, LongArray
from trocar.services.mechanics.scenarios import insertion
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.mechanics.simulation.scene_duct import build_scene_duct
from trocar.studies.feel.hands import servo_settings

WITHIN = 0.05
#: Added to every answer, ms; and the most that is added to each by itself, drawn evenly.
ADDED: tuple[tuple[int, int], ...] = (
    (0, 0), (2, 0), (5, 0), (10, 0), (20, 0), (100, 0), (0, 5), (0, 20), (0, 100),
)  # fmt: skip
TOOLS = ("catheter", "wall")
_LONG_AGO = 10**6


@dataclass(frozen=True)
class Solved:
    """What mechanics found, tick by tick: poses and velocities (n, 2, 3), forces (n, 2, 3), stiffness (n, 2, 9)."""

    position_m: FloatArray
    velocity_m_s: FloatArray
    force_n: FloatArray
    stiffness_n_m: FloatArray


@dataclass(frozen=True)
class Late:
    """How far from the solved force a hand's is, as a share of its largest: (n,) by local models and by force alone."""

    tool: str
    added_ms: int
    jitter_ms: int
    local: FloatArray
    force_alone: FloatArray


def solve(cache: Path, pace: float = 1.0) -> Solved:
    """Step the insertion in process, its hands at ``pace``."""
    scenario = insertion()
    simulation, tools = Simulation(scenario.scene, build_scene_duct(scenario.scene, cache)), ToolInputs()
    n = round(scenario.duration_s / pace / TICK_S)
    places, forces, stiffness = np.empty((n, 2, 3)), np.empty((n, 2, 3)), np.empty((n, 2, 9))
    for k in range(n):
        scenario.write_inputs((k + 1) * TICK_S * pace, tools)
        simulation.step(tools)
        places[k], forces[k] = tools.position_m, simulation.tool_results.force_n
        stiffness[k] = simulation.tool_results.stiffness_n_m.reshape(2, 9)
    velocities = np.diff(places, axis=0, prepend=places[:1]) / TICK_S
    return Solved(places, velocities, forces, stiffness)


def answer_late(solved: Solved, added: Sequence[tuple[int, int]] = ADDED, seed: int = 0) -> list[Late]:
    """Return what both hands feel for each of ``added``: ms to all answers, and up to so many to each."""
    rows = []
    for added_ms, jitter_ms in added:
        newest = newest_answer(len(solved.force_n), added_ms, jitter_ms, np.random.default_rng(seed))
        for tool, name in enumerate(TOOLS):
            asked = solved.force_n[:, tool]
            largest = np.linalg.norm(asked, axis=1).max()
            held = np.where(newest[:, None] >= 0, asked[np.maximum(newest, 0)], 0.0)
            felt = (_by_local_models(solved, tool, newest), held)
            local, alone = (np.linalg.norm(each - asked, axis=1) / largest for each in felt)
            rows.append(Late(name, added_ms, jitter_ms, local, alone))
    return rows


def newest_answer(n: int, added_ms: int, jitter_ms: int, random: np.random.Generator) -> LongArray:
    """Return the tick that the newest answer at each of n ticks is about, negative before the first has come."""
    comes = np.arange(n) + 1 + added_ms + np.floor(random.uniform(0.0, jitter_ms + 1.0, n)).astype(np.int64)
    newest = np.full(n, -_LONG_AGO, np.int64)
    for about, at in enumerate(comes):
        if at < n:
            newest[at] = max(newest[at], about)
    return np.maximum.accumulate(newest)


def _by_local_models(solved: Solved, tool: int, newest: LongArray) -> FloatArray:
    model, motion, memory = np.zeros(MODEL_COLUMNS), np.zeros(6), np.zeros(MEMORY_SIZE)
    limits, now = servo_settings()
    felt = np.empty((len(newest), 3))
    for k, about in enumerate(newest):
        if about >= 0:
            model[MODEL_F0 : MODEL_F0 + 3] = solved.force_n[about, tool]
            model[MODEL_K : MODEL_K + 9] = solved.stiffness_n_m[about, tool]
            model[MODEL_X0 : MODEL_X0 + 3] = solved.position_m[about, tool]
            model[MODEL_CONTACT] = float(solved.force_n[about, tool].any())
        motion[:3], motion[3:] = solved.position_m[k, tool], solved.velocity_m_s[k, tool]
        now[NOW_AGE] = (k - about) * TICK_S
        servo_force(model, motion, limits, now, memory)
        felt[k] = memory[MEMORY_FORCE : MEMORY_FORCE + 3]
    return felt
