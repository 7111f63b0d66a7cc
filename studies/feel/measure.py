"""The figures of what is felt: borders, rendered stiffness, energies; all from the servo's own law."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Iterable
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial

from trocar.studies.feel.hands import Attack, Book, attack_servo, random_attack
from trocar.studies.feel.hunt import AS_FILED, HUNTED_KG, MASSES_KG, Hunted, Told, hunt, hunt_pairs
from trocar.studies.feel.slow_hands import TOLD, WALLS_N_M, Slow, feel_walls
from trocar.studies.feel.virtual_wall import (
    VirtualWall,
    measured_passive_friction,
    measured_stable_stiffness,
    passive_friction,
    response,
    stable_stiffness,
)
from trocar.studies.progress import Tell

STIFFNESSES_N_M = (100.0, 200.0, 500.0, 1000.0, 2000.0, 3500.0)
DAMPINGS_N_S_M = (0.0, 0.2, 0.5)
PERIODS_S = (0.5e-3, 1e-3, 2e-3, 4e-3)
DELAYS = (0, 1, 2, 5, 10, 20, 50, 100)
#: Those of the table; the figure has more between them.
TABLE_HZ = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)
FREQUENCIES_HZ = tuple(sorted({*TABLE_HZ, *(round(10.0 ** (k / 20.0), 3) for k in range(41))}))
#: A local model is a parameter, not a signal: nothing of the loop waits for it.
LOCAL = None
#: Which way the force comes, and how many ticks old it is; None is the local model.
WAYS: tuple[tuple[str, int | None], ...] = (
    ("local model, any delay of the bus up to 5 ms", LOCAL),
    ("force over the bus, 1 ms", 1),
    ("force over the bus, 5 ms", 5),
    ("force over the bus, 20 ms", 20),
    ("force over the bus, 100 ms", 100),
)
#: What servos are told of delay and friction when hands are hunted for: what the device files tell, then other delays,
#: and arms that need have no friction at all.
HUNTED_WITH = (AS_FILED, Told(0.1e-3), Told(0.3e-3), Told(1e-3))
FRICTIONLESS = Told(0.1e-3, 0.0)
#: What a hand may be up against: whether stiffness travels, whether a force gives no more than was put in.
KINDS: tuple[tuple[str, bool, bool], ...] = (
    ("local model, bounded", True, True),
    ("local model, not bounded", True, False),
    ("force over the bus, bounded", False, True),
    ("force over the bus, not bounded", False, False),
)


@dataclass(frozen=True)
class Border:
    """One border: theory and what was measured, in the unit of the table that it is in."""

    wall: VirtualWall
    theory: float
    measured: float

    @property
    def error(self) -> float:
        """Relative."""
        return self.measured / self.theory - 1.0


@dataclass(frozen=True)
class Rendered:
    """What a wall of 500 N/m is at a frequency, for one way of the force."""

    way: str
    lag_s: float
    frequency_hz: float
    stiffness: complex

    @property
    def share(self) -> float:
        """Magnitude over what was asked for."""
        return abs(self.stiffness) / 500.0

    @property
    def late_deg(self) -> float:
        """How far the force is behind the position, in degrees; whole turns from what hold and delay take."""
        late = -math.degrees(cmath.phase(self.stiffness))
        return late + 360.0 * round(self.frequency_hz * self.lag_s - late / 360.0)


@dataclass(frozen=True)
class Energies:
    """What one kind of servo gave to many hands."""

    kind: str
    attacks: tuple[Attack, ...]
    books: tuple[Book, ...]

    @property
    def gaining(self) -> int:
        """How many hands got more than they put in."""
        return sum(book.gained_j > 0.0 for book in self.books)

    @property
    def worst_j(self) -> float:
        """The most that a hand got, or the least that it lost (negative)."""
        return max(book.gained_j for book in self.books)

    @property
    def servo_gaining(self) -> int:
        """How often more came out of the servo alone, the arm's friction not counted."""
        return sum(book.servo_j > 1e-9 for book in self.books)


def passive_borders() -> list[Border]:
    """Return the friction that makes walls passive, over stiffness, damping and delay."""
    walls = [VirtualWall(k, b) for b in DAMPINGS_N_S_M for k in STIFFNESSES_N_M]
    walls += [VirtualWall(500.0, delay=delay) for delay in DELAYS[1:6]]
    return [Border(wall, passive_friction(wall), measured_passive_friction(wall)) for wall in walls]


def stable_borders() -> list[Border]:
    """Return the stiffness up to which walls are stable, over rate, friction, damping and delay of the loop."""
    walls = [VirtualWall(1.0, friction_n_s_m=b, period_s=t) for t in PERIODS_S for b in (0.05, 0.1)]
    walls += [VirtualWall(1.0, damping_n_s_m=b) for b in DAMPINGS_N_S_M]
    walls += [VirtualWall(1.0, delay=delay) for delay in DELAYS[1:]]
    return [
        Border(
            replace(wall, stiffness_n_m=stable_stiffness(wall)), stable_stiffness(wall), measured_stable_stiffness(wall)
        )
        for wall in walls
    ]


def transparency() -> list[Rendered]:
    """Return what a wall of 500 N/m is to a hand that moves at 1 to 100 Hz, by each way of the force."""
    wall = VirtualWall(500.0)
    return [
        Rendered(name, replace(wall, delay=delay or 0).lag_s, hz, response(wall, hz, delay))
        for name, delay in WAYS
        for hz in FREQUENCIES_HZ
    ]


def energies(count: int, executor: Executor, tell: Tell) -> list[Energies]:
    """Return what `count` hands got out of each kind of servo; seeds 0 to `count` - 1."""
    found = []
    for kind, local, bounded in KINDS:
        attacks = tuple(random_attack(seed, local=local, bounded=bounded) for seed in range(count))
        books = tuple(_told(executor.map(attack_servo, attacks, chunksize=8), kind, count, tell))
        found.append(Energies(kind, attacks, books))
    return found


def hunts(count: int, executor: Executor, tell: Tell) -> list[Hunted]:
    """Return what searches found at each arm and for pairs, the bound on and off; 10 hands for each of `count`."""
    searches = max(1, count // 100)
    asked: list[tuple[Callable[..., Hunted], tuple[str | int, ...], bool]]
    asked = [(partial(hunt, told=told), (name, searches), True) for name in HUNTED_KG for told in HUNTED_WITH]
    asked += [(partial(hunt, told=FRICTIONLESS), (name, searches), True) for name in MASSES_KG]
    asked += [(hunt_pairs, (max(1, searches // 5),), True)]
    asked += [(hunt, (name, 1), False) for name in MASSES_KG] + [(hunt_pairs, (1,), False)]
    waiting = [executor.submit(partial(ask, *words, bounded=bounded)) for ask, words, bounded in asked]
    found = []
    for done, each in enumerate(waiting, 1):
        found.append(each.result())
        tell("searches", done, len(waiting))
    return found


def slow_rows(count: int) -> list[Slow]:
    """Return what `count` slow hands at each arm feel of walls."""
    return [feel_walls(name, walls, max(1, count)) for name in MASSES_KG for walls in WALLS_N_M]


def told_rows(count: int) -> list[tuple[float, Slow]]:
    """Return what they feel of the softest walls where models have another local stiffness, with its factor."""
    return [(each, feel_walls(name, WALLS_N_M[0], max(1, count), local=each)) for name in MASSES_KG for each in TOLD]


def _told(books: Iterable[Book], kind: str, count: int, tell: Tell) -> Iterable[Book]:
    for done, book in enumerate(books, 1):
        tell(kind, done, count)
        yield book
