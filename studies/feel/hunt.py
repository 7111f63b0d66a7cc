"""The hunt for a hand that gets energy out of the servo: ``python -m studies.feel.hunt``, as rows of a table.

Searches begin anew at many places, half of them for the most energy, half for the most of all that went to and fro.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from services.gateway.device_files import ArmFile
from services.mechanics.arrays import FloatArray
from services.runtime import config
from studies.feel.search import search
from studies.feel.wall_hands import GAINED, MOVED, RANGES, ArmAtWall, arm_at_wall, books_of, decode

#: Apparent mass at the tip, kg, and what holds it: vendors' data sheets at second hand, and a finger's part.
MASSES_KG = {"phantom_premium_1_5": 0.1, "touch": 0.06, "touch_x": 0.07}
GENERATIONS = 80


@dataclass(frozen=True)
class Hunted:
    """What came of all hands at one arm: how many, how many gained, and the most that one had, J."""

    arm: str
    controller: bool
    hands: int
    gaining: int
    most_j: float


def hunt(name: str, searches: int, *, controller: bool = True, first_seed: int = 0) -> Hunted:
    """Search for hands that gain at one arm; without ``controller`` the law has no passivity controller."""
    file = config.load(ArmFile, config.find("device", name))[0]
    arm = arm_at_wall(file, MASSES_KG[name], controller=controller)
    gained = np.concatenate(list(_gained(arm, searches, first_seed)))
    return Hunted(name, controller, len(gained), int(np.sum(gained > 0.0)), float(gained.max()))


def _gained(arm: ArmAtWall, searches: int, first_seed: int) -> Iterator[FloatArray]:
    for seed in range(first_seed, first_seed + searches):
        found: list[FloatArray] = []

        def value(points: FloatArray, seed: int = seed, found: list[FloatArray] = found) -> FloatArray:
            books = books_of(decode(points), arm)
            found.append(books[:, GAINED])
            return books[:, GAINED] / np.maximum(books[:, MOVED], 1e-6) if seed % 2 else books[:, GAINED]

        search(value, len(RANGES), GENERATIONS, seed)
        yield np.concatenate(found)


def main() -> None:
    """Print a row for each arm, with the passivity controller and without."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--searches", type=int, default=40, help="at each arm")
    parser.add_argument("--seed", type=int, default=0, help="of the first")
    asked = parser.parse_args()
    _say("| arm | controller | hands | gained | most, mJ |")
    _say("| --- | --- | --- | --- | --- |")
    for controller in (True, False):
        for name in MASSES_KG:
            searches = asked.searches if controller else max(1, asked.searches // 10)
            row = hunt(name, searches, controller=controller, first_seed=asked.seed)
            most = f"{1e3 * row.most_j:.3f}" if row.most_j > 0.0 else "nothing"
            yes = "yes" if controller else "no"
            _say(f"| {row.arm} | {yes} | {row.hands:,} | {row.gaining:,} | {most} |")


def _say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
