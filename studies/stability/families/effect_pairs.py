"""All pairs of effects, each with nothing else."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from itertools import combinations

from trocar.services.mechanics.effects import EFFECTS
from trocar.studies.stability.drive import Play
from trocar.studies.stability.family import Case, Draw, played
from trocar.studies.stability.situations import threaded
from trocar.studies.stability.strokes import stroking


def cases(draw: Draw) -> Iterator[Case]:
    """Strokes of both tools with every pair, twice."""
    for one, other in combinations(EFFECTS, 2) if draw.is_long else [("twist", "friction")]:
        for k in range(2 if draw.is_long else 1):
            name = f"{one} and {other}, number {k}"
            yield played(name, partial(_play, draw, name, one, other))


def _play(draw: Draw, name: str, one: str, other: str) -> Play:
    start = threaded()
    scene = replace(start.scene, effects={each: EFFECTS[each].kind.Settings() for each in (one, other)})
    return Play(scene=scene, hands=stroking(start, draw.random(f"effect pairs {name}"), 300))
