"""The step itself: from 0.1 to 50 ms; two milliseconds also at once, as on a rung of the quality ladder."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

from trocar.services.mechanics.scene import QualityLevel
from trocar.studies.stability.drive import Play
from trocar.studies.stability.family import Case, Draw, played
from trocar.studies.stability.situations import approaching, beside, threaded
from trocar.studies.stability.strokes import at_step, stroking

STEPS_MS = 0.1, 0.25, 0.5, 2.0, 5.0, 10.0, 20.0, 50.0
HAND_STEP_MS = 5.0
"""Up to here a tick of a hand's motion is judged as one."""
SITUATIONS = {"holding": threaded, "approaching": approaching, "beside": beside}


def cases(draw: Draw) -> Iterator[Case]:
    """Strokes at every step, fewer at the small ones, which take long."""
    for step in STEPS_MS if draw.is_long else (10.0,):
        for situation in SITUATIONS if draw.is_long else ("holding",):
            for k in range(6 if draw.is_long and step >= 1.0 else 1):
                name = f"{step:g} ms, {situation}, number {k}"
                yield played(name, partial(_play, draw, name, step, situation))
    for situation in SITUATIONS if draw.is_long else ("holding",):
        for k in range(6 if draw.is_long else 1):
            name = f"2 ms at once, {situation}, number {k}"
            yield played(name, partial(_play_at_once, draw, name, situation))


def _play_at_once(draw: Draw, name: str, situation: str) -> Play:
    play = _play(draw, name, 2.0, situation)
    return replace(play, scene=replace(play.scene, quality=(QualityLevel(ticks_per_step=2),)), may_jump=False)


def _play(draw: Draw, name: str, step_ms: float, situation: str) -> Play:
    start = SITUATIONS[situation]()
    hands = stroking(start, draw.random(f"steps {name}"), 300)
    return Play(
        scene=start.scene, hands=at_step(hands, 1e-3 * step_ms), dt_s=1e-3 * step_ms, may_jump=step_ms > HAND_STEP_MS
    )
