"""The hunt for hands that get energy out of the servo: ``python -m trocar.studies.feel.hunt [--pairs]``, as rows of a
table.

Every hand has its own delay of forces, their jitter and the arm's friction, within what the servo is told.
Searches begin anew at many places, half of them for the most energy, half for the most of all that went to and fro.
"""

from __future__ import annotations

if __name__ == "__main__":
    import trocar.services.start.entry  # noqa: F401  the environment of a process, before numpy

import argparse
import math
import sys
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from trocar.services.gateway.devices.device_files import ArmFile, GraspFile
from trocar.services.gateway.simulated.emulated_drive import INERTIA
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.runtime.config import config
from trocar.studies.feel.pairs import DIMENSIONS, books_of_pairs
from trocar.studies.feel.search import search
from trocar.studies.feel.wall_hands import GAINED, LEVER_M, MOVED, RANGES, ArmAtWall, arm_at_wall, books_of, decode

#: Apparent mass at the tip, kg, and what holds it: vendors' data sheets at second hand, and a finger's part.
MASSES_KG = {"phantom_premium_1_5": 0.1, "touch": 0.06, "touch_x": 0.07}
#: Devices that are hunted at, with their masses: the arms, and the handle of the emulated drive on its lever.
HUNTED_KG = {**MASSES_KG, "grasp_odrive": INERTIA / LEVER_M**2}
#: More than this is a gain, J.
GAIN_J = 1e-6
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
        most = f"{1e3 * self.most_j:.4f} mJ" if self.most_j > 0.0 else "nothing"
        bounded = "yes" if self.bounded else "no"
        return f"| {self.arm} | {bounded} | {self.hands:,} | {self.gaining:,} | {most} |"


@dataclass(frozen=True)
class Told:
    """What a servo is told, instead of what the device file tells, and what is so; None: as the file tells.

    Attributes:
        delay_s: The longest delay that it is told.
        friction: The share of the vendor's friction that it is told.
        late_s: The longest delay that there is; none: that which it is told.
        least: The least share of the vendor's friction that there is; none: that which it is told.
    """

    delay_s: float | None = None
    friction: float | None = None
    late_s: float | None = None
    least: float | None = None


AS_FILED = Told()


def arm_of(name: str, *, bounded: bool = True, told: Told = AS_FILED) -> ArmAtWall:
    """Return a device of `HUNTED_KG`, as a mass; not ``bounded`` a force may give what was not put in."""
    kind: type[ArmFile] | type[GraspFile] = ArmFile if name in MASSES_KG else GraspFile
    file: ArmFile | GraspFile = config.load(kind, config.find("device", name))[0]
    instead = {"interface_delay_s": told.delay_s, "sure_friction": told.friction}
    file = file.model_copy(update={key: value for key, value in instead.items() if value is not None})
    return arm_at_wall(file, HUNTED_KG[name], bounded=bounded, late_s=told.late_s, least=told.least)


def hunt(
    name: str,
    searches: int,
    *,
    bounded: bool = True,
    told: Told = AS_FILED,
    first_seed: int = 0,
    generations: int = GENERATIONS,
    enough_j: float = math.inf,
) -> Hunted:
    """Search for hands that gain at one device, until one has gained more than `enough_j`."""
    arm = arm_of(name, bounded=bounded, told=told)
    seeds = range(first_seed, first_seed + searches)
    gained = _gained(lambda points: books_of(decode(points), arm), len(RANGES), seeds, generations, enough_j)
    return _hunted(arm_label(name, told), bounded, gained)


def arm_label(name: str, told: Told) -> str:
    """Return the name of a device, with what its servo is told instead of its file."""
    said = [f"{1e3 * told.delay_s:g} ms"] if told.delay_s is not None else []
    said += [f"{told.friction:.0%} of friction"] if told.friction is not None else []
    return ", told ".join([name, " and ".join(said)]) if said else name


def _hunted(arm: str, bounded: bool, gained: FloatArray) -> Hunted:
    return Hunted(arm, bounded, len(gained), int(np.sum(gained > GAIN_J)), float(gained.max()))


def hunt_pairs(searches: int, *, bounded: bool = True, first_seed: int = 0, generations: int = GENERATIONS) -> Hunted:
    """Search for pairs of hands that gain together, at the linked Premium."""
    seeds = range(first_seed, first_seed + searches)
    gained = _gained(lambda points: books_of_pairs(points, bounded=bounded), DIMENSIONS, seeds, generations)
    return _hunted("two linked Premiums", bounded, gained)


def _gained(books_of: Books, dimensions: int, seeds: range, generations: int, enough_j: float = math.inf) -> FloatArray:
    """Return what each hand gained that the searches looked at, J."""
    found: list[FloatArray] = []

    def is_found() -> bool:
        return bool(found[-1].max() > enough_j)

    for seed in seeds:

        def value(points: FloatArray, seed: int = seed) -> FloatArray:
            books = books_of(points)
            found.append(books[:, GAINED])
            return books[:, GAINED] / np.maximum(books[:, MOVED], 1e-6) if seed % 2 else books[:, GAINED]

        search(value, dimensions, generations, seed, is_found=is_found)
        if is_found():
            break
    return np.concatenate(found)


def main() -> None:
    """Print a row for each arm, with the bound by energy and without."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--searches", type=int, default=40, help="at each arm")
    parser.add_argument("--seed", type=int, default=0, help="of the first")
    parser.add_argument("--pairs", action="store_true", help="two hands at one piece of tissue, linked Premiums")
    parser.add_argument("--device", choices=tuple(HUNTED_KG), action="append", help="none: every one")
    parser.add_argument("--delay-ms", type=float, help="longest delay that servos are told; none: of the device file")
    parser.add_argument("--late-ms", type=float, help="longest delay that there is; none: what is told")
    parser.add_argument("--friction", type=float, help="share of the friction that servos are told; none: of the file")
    parser.add_argument("--least", type=float, help="least share of the friction that there is; none: what is told")
    asked = parser.parse_args()
    delay_s, late_s = (None if each is None else 1e-3 * each for each in (asked.delay_ms, asked.late_ms))
    told = Told(delay_s, asked.friction, late_s, asked.least)
    _say("| arm | bounded | hands | gained | most |")
    _say("| --- | --- | --- | --- | --- |")
    for bounded in (True, False):
        searches = asked.searches if bounded else max(1, asked.searches // 10)
        if asked.pairs:
            _say(hunt_pairs(searches, bounded=bounded, first_seed=asked.seed).row())
            continue
        for name in asked.device or HUNTED_KG:
            _say(hunt(name, searches, bounded=bounded, told=told, first_seed=asked.seed).row())


def _say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
