"""The step itself: from 0.1 to 50 ms, or another one in every tick."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from services.studies.stability.drive import Play
from services.studies.stability.family import Case, Draw, played
from services.studies.stability.situations import approaching, beside, threaded
from services.studies.stability.strokes import at_step, stroking

STEPS_MS = 0.1, 0.25, 0.5, 2.0, 5.0, 10.0, 20.0, 50.0
SITUATIONS = {"holding": threaded, "approaching": approaching, "beside": beside}


def cases(draw: Draw) -> Iterator[Case]:
    """Strokes at every step, fewer at the small ones, which take long."""
    for step in STEPS_MS if draw.is_long else (10.0,):
        for situation in SITUATIONS if draw.is_long else ("holding",):
            for k in range(6 if draw.is_long and step >= 1.0 else 1):
                name = f"{step:g} ms, {situation}, number {k}"
                yield played(name, partial(_play, draw, name, step, situation))


def _play(draw: Draw, name: str, step_ms: float, situation: str) -> Play:
    start = SITUATIONS[situation]()
    hands = stroking(start, draw.random(f"steps {name}"), 300)
    return Play(scene=start.scene, hands=at_step(hands, 1e-3 * step_ms), dt_s=1e-3 * step_ms, may_jump=step_ms > 1.0)
