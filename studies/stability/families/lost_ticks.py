"""What comes of the hands comes late, twice, or not at all, while they move as in an insertion."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from trocar.services.mechanics.arrays import IntArray
from trocar.studies.stability.drive import Play
from trocar.studies.stability.family import Case, Draw, played
from trocar.studies.stability.situations import LEAD_STEPS, approaching, threaded
from trocar.studies.stability.strokes import stroking

SITUATIONS = {"holding": threaded, "approaching": approaching}
MOVING_STEPS = 450
STALLS_MS = 5, 20, 50, 250
COUNT = 12


def cases(draw: Draw) -> Iterator[Case]:
    """Random strokes in which ticks are lost by chance, arrive in bursts, or stop coming for a while."""
    faults: dict[str, Fault] = {
        "jitter": _jitter,
        "20 % lost": _lossy,
        **{f"{ms} ms stall": partial(_stall, ms) for ms in STALLS_MS},
        **{f"{ms} ms frozen": partial(_freeze, ms) for ms in STALLS_MS},
    }
    if not draw.is_long:
        faults = {name: faults[name] for name in ("20 % lost", "250 ms stall")}
    for fault, index in faults.items():
        for situation in SITUATIONS if draw.is_long else ("holding",):
            for k in range(COUNT if draw.is_long else 1):
                name = f"{fault}, {situation}, number {k}"
                yield played(name, partial(_play, draw, name, situation, index))


Fault = Callable[[int, np.random.Generator], IntArray]
"""From a number of ticks to the tick whose sample each step gets."""


def _jitter(ticks: int, random: np.random.Generator) -> IntArray:
    """Samples up to 2 ms old or young, some twice, some never."""
    late = np.arange(ticks) + random.integers(-2, 3, ticks)
    return np.maximum.accumulate(np.clip(late, 0, ticks - 1)).astype(np.int32)


def _lossy(ticks: int, random: np.random.Generator) -> IntArray:
    """One in five never comes: the step takes the one before."""
    arrived = random.random(ticks) >= 0.2
    arrived[0] = True
    return np.maximum.accumulate(np.where(arrived, np.arange(ticks), 0)).astype(np.int32)


def _stall(ms: int, ticks: int, random: np.random.Generator) -> IntArray:
    """Nothing is stepped for a while, and the hands go on: once, in the middle of the motion."""
    start = LEAD_STEPS + int(random.integers(20, 150))
    return np.delete(np.arange(ticks), slice(start, start + ms)).astype(np.int32)


def _freeze(ms: int, ticks: int, random: np.random.Generator) -> IntArray:
    """Steps go on with the same sample for a while, then comes the present one."""
    start = LEAD_STEPS + int(random.integers(20, 150))
    index = np.arange(ticks)
    index[start : start + ms] = start
    return index.astype(np.int32)


def _play(draw: Draw, name: str, situation: str, index: Fault) -> Play:
    start, random = SITUATIONS[situation](), draw.random(f"lost ticks {name}")
    hands = stroking(start, random, MOVING_STEPS)
    return Play(scene=start.scene, hands=hands.sampled(index(len(hands), random)), may_jump=True)
