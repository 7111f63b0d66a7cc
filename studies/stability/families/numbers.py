"""Numbers that are none, from a device or from a caller: NaN, infinities, what overflows, a step without a length."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from trocar.services.mechanics.collision.pairs import CATHETER_SEGMENT
from trocar.services.mechanics.scene.tools import GraspHold, ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.studies.stability.drive import Driven, Play, reduced_duct
from trocar.studies.stability.family import Case, Draw, played
from trocar.studies.stability.situations import LEAD_STEPS, threaded
from trocar.studies.stability.strokes import stroking

STEPS = 300
VALUES = {"nan": np.nan, "inf": np.inf, "-inf": -np.inf, "1e200": 1e200, "1e30": 1e30, "1e308": 1e308}
PLACES = "position_m", "jaw_angle_rad", "roll_rad"
STEPS_S = 0.0, -1e-3, np.nan, np.inf, -np.inf


def cases(draw: Draw) -> Iterator[Case]:
    """One number in one tick in fifty of each tool, for each kind of number and place; and steps and holds."""
    for value in VALUES if draw.is_long else ("nan",):
        for place in PLACES if draw.is_long else ("position_m",):
            for k in range(3 if draw.is_long else 1):
                name = f"{value} in {place}, number {k}"
                yield played(name, partial(_play, draw, name, value, place))
    yield Case("steps without a length", _steps_without_length)
    for value in VALUES if draw.is_long else ("1e200",):
        yield played(f"{value} in a hold", partial(_hold, VALUES[value]))


def _play(draw: Draw, name: str, value: str, place: str) -> Play:
    start, random = threaded(), draw.random(f"numbers {name}")
    hands = stroking(start, random, STEPS)
    column = getattr(hands, place).copy()
    spoilt = random.random(column.shape) < 0.02
    spoilt[: LEAD_STEPS // 2] = False
    column[spoilt] = VALUES[value]
    return Play(scene=start.scene, hands=replace(hands, **{place: column}), may_jump=True)


def _hold(value: float) -> Play:
    """A caller's hold whose limit, place and opening are this number."""
    start = threaded()
    weights = np.array([1.0 - value, value, 0.0])
    hold = GraspHold(7, 0, CATHETER_SEGMENT, 20, weights, value, value)
    return Play(scene=start.scene, hands=replace(start.hands, holds=(hold,)), may_jump=True)


def _steps_without_length() -> Driven:
    """Each is refused, and the next step goes on as if it had not been asked for."""
    start = threaded()
    asked, plain = (Simulation(start.scene, reduced_duct(start.scene)) for _ in range(2))
    tools = ToolInputs()
    wrong = 0
    for step in range(100):
        start.hands.write(step, tools)
        for simulation in (asked, plain):
            simulation.step(tools)
        try:
            asked.step(tools, STEPS_S[step % len(STEPS_S)])
            wrong += 1
        except ValueError:
            pass
    same = np.array_equal(asked.catheter.state.position_m, plain.catheter.state.position_m)
    return Driven({"wrong_answers": float(wrong + (not same))}, repr(plain.catheter.state.position_m[-1]), 200)
