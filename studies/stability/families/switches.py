"""The quality level switches in every tick."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

from trocar.services.mechanics.scene import QualityLevel
from trocar.services.mechanics.simulation import Simulation
from trocar.studies.stability.drive import Play
from trocar.studies.stability.family import Case, Draw, played
from trocar.studies.stability.situations import approaching, threaded
from trocar.studies.stability.strokes import stroking

LADDER = (
    QualityLevel(),
    QualityLevel(name="half", iterations=15),
    QualityLevel(name="low", iterations=3),
    QualityLevel(name="least", iterations=1),
)
SITUATIONS = {"holding": threaded, "approaching": approaching}


def cases(draw: Draw) -> Iterator[Case]:
    """By turns through the ladder, or at random."""
    for situation in SITUATIONS if draw.is_long else ("holding",):
        for k in range(10 if draw.is_long else 1):
            name = f"{situation}, number {k}"
            yield played(name, partial(_play, draw, name, situation, by_chance=k % 2 == 1))


def _play(draw: Draw, name: str, situation: str, *, by_chance: bool) -> Play:
    start, random = SITUATIONS[situation](), draw.random(f"switches {name}")
    hands = stroking(start, random, 300)
    drawn = random.integers(len(LADDER), size=10_000)

    def switch(simulation: Simulation, step: int) -> None:
        simulation.set_quality(int(drawn[step % len(drawn)]) if by_chance else step % len(LADDER))

    return Play(scene=replace(start.scene, quality=LADDER), hands=hands, before_step=switch)
