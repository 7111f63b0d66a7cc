"""The hunt for hands that get energy out of the servo: ``python -m trocar.studies.feel.hunt [--pairs]``, as rows of a
table.

Searches begin anew at many places, half of them for the most energy, half for the most of all that went to and fro.
"""

from __future__ import annotations

if __name__ == "__main__":
    import trocar.services.entry  # noqa: F401  the environment of a process, before numpy

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from trocar.services.gateway.device_files import ArmFile
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.runtime import config
from trocar.studies.feel.pairs import DIMENSIONS, books_of_pairs
from trocar.studies.feel.search import search
from trocar.studies.feel.wall_hands import GAINED, MOVED, RANGES, ArmAtWall, arm_at_wall, books_of, decode

#: Apparent mass at the tip, kg, and what holds it: vendors' data sheets at second hand, and a finger's part.
MASSES_KG = {"phantom_premium_1_5": 0.1, "touch": 0.06, "touch_x": 0.07}
GENERATIONS = 80

Books = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class Hunted:
    """What came of all hands, or pairs: at which arm, how many, how many gained, and the most that one had, J."""

    arm: str
    bounded: bool
    hands: int
    gaining: int
    most_j: float

    def row(self) -> str:
        """Return it as a row of a table."""
        most = f"{1e3 * self.most_j:.3f} mJ" if self.most_j > 0.0 else "nothing"
        bounded = "yes" if self.bounded else "no"
        return f"| {self.arm} | {bounded} | {self.hands:,} | {self.gaining:,} | {most} |"


def arm_of(name: str, *, bounded: bool = True) -> ArmAtWall:
    """Return the arm of a device file, as a mass."""
    return arm_at_wall(config.load(ArmFile, config.find("device", name))[0], MASSES_KG[name], bounded=bounded)


def hunt(
    name: str, searches: int, *, bounded: bool = True, first_seed: int = 0, generations: int = GENERATIONS
) -> Hunted:
    """Search for hands that gain at one arm; not ``bounded`` a force may give what was not put in."""
    arm = arm_of(name, bounded=bounded)
    seeds = range(first_seed, first_seed + searches)
    gained = _gained(lambda points: books_of(decode(points), arm), len(RANGES), seeds, generations)
    return Hunted(name, bounded, len(gained), int(np.sum(gained > 0.0)), float(gained.max()))


def hunt_pairs(searches: int, *, bounded: bool = True, first_seed: int = 0, generations: int = GENERATIONS) -> Hunted:
    """Search for pairs of hands that gain together, at the linked Premium."""
    seeds = range(first_seed, first_seed + searches)
    gained = _gained(lambda points: books_of_pairs(points, bounded=bounded), DIMENSIONS, seeds, generations)
    return Hunted("two linked Premiums", bounded, len(gained), int(np.sum(gained > 0.0)), float(gained.max()))


def _gained(books_of: Books, dimensions: int, seeds: range, generations: int) -> FloatArray:
    """Return what each hand gained that the searches looked at, J."""
    found: list[FloatArray] = []
    for seed in seeds:

        def value(points: FloatArray, seed: int = seed) -> FloatArray:
            books = books_of(points)
            found.append(books[:, GAINED])
            return books[:, GAINED] / np.maximum(books[:, MOVED], 1e-6) if seed % 2 else books[:, GAINED]

        search(value, dimensions, generations, seed)
    return np.concatenate(found)


def main() -> None:
    """Print a row for each arm, with the bound by energy and without."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--searches", type=int, default=40, help="at each arm")
    parser.add_argument("--seed", type=int, default=0, help="of the first")
    parser.add_argument("--pairs", action="store_true", help="two hands at one piece of tissue, linked Premiums")
    asked = parser.parse_args()
    _say("| arm | bounded | hands | gained | most |")
    _say("| --- | --- | --- | --- | --- |")
    for bounded in (True, False):
        searches = asked.searches if bounded else max(1, asked.searches // 10)
        if asked.pairs:
            _say(hunt_pairs(searches, bounded=bounded, first_seed=asked.seed).row())
            continue
        for name in MASSES_KG:
            _say(hunt(name, searches, bounded=bounded, first_seed=asked.seed).row())


def _say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
