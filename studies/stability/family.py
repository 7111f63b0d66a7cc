"""What a family of cases is."""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import Enum

import numpy as np

from trocar.studies.stability.drive import Driven, Play, drive


class Reach(Enum):
    """How much of every family is run."""

    QUICK = "quick"
    LONG = "long"


@dataclass(frozen=True, slots=True)
class Case:
    """One run of a family.

    Attributes:
        name: str. It tells the case from all others of its family.
        run: callable. What to do.
        play: callable, optional. The play, where it is one.
        traits: callable, optional. Words for what was drawn, by which cases that have something in common are counted.
    """

    name: str
    run: Callable[[], Driven]
    play: Callable[[], Play] | None = None
    traits: Callable[[], tuple[str, ...]] | None = None


@dataclass(frozen=True, slots=True)
class Draw:
    """What a family is drawn with: how many, and from which seed.

    Attributes:
        reach: Reach
        seed: int
        cases: int, optional. So many of a family of which each case is drawn afresh, whatever the reach.
    """

    reach: Reach
    seed: int
    cases: int | None = None

    @property
    def is_long(self) -> bool:
        """Whether all of the family is wanted."""
        return self.reach is Reach.LONG

    def random(self, name: str) -> np.random.Generator:
        """A generator of its own for every case: leaving one out does not change the others."""
        return np.random.default_rng([self.seed, zlib.crc32(name.encode())])


@dataclass(frozen=True, slots=True)
class Family:
    """A kind of hard case.

    Attributes:
        what: str. For the table's reader.
        cases: callable. From a draw to the cases, cheap: ducts and simulations are built when a case runs.
        may_heal: bool. Whether its input is one that no state can be expected to bear, so that a heal is no failure.
    """

    what: str
    cases: Callable[[Draw], Iterable[Case]]
    may_heal: bool = False


def played(name: str, play: Callable[[], Play]) -> Case:
    """A case that drives a play; what it needs is made when it runs."""
    return Case(name, lambda: drive(play()), play)


def log_uniform(random: np.random.Generator, low: float, high: float) -> float:
    """Return a number from `low` to `high`, each factor of it as likely as any other."""
    return math.exp(random.uniform(math.log(low), math.log(high)))
