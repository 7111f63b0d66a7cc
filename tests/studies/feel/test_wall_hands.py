"""Hands at a wall: the one that drew back fast, and those that a search finds."""

from __future__ import annotations

import numpy as np
import pytest

from tests.by_day import by_day
from trocar.services.mechanics.arrays import FloatArray
from trocar.studies.feel.hunt import (
    AS_FILED,
    GAIN_J,
    GENERATIONS,
    HUNTED_KG,
    MASSES_KG,
    Told,
    arm_of,
    hunt,
    hunt_pairs,
)
from trocar.studies.feel.search import search
from trocar.studies.feel.slow_hands import WALLS_N_M, feel_walls
from trocar.studies.feel.wall_hands import GAINED, LARGEST, books_of


@pytest.mark.parametrize("wall_n_m", [300.0, 1000.0, 2000.0])
def test_a_hand_that_presses_slowly_and_draws_back_fast_gains_nothing(wall_n_m: float) -> None:
    """A hand of 1,000 N/m, 4 mm, 0.7 m/s: it gained 5 mJ of a wall of 2,000 while force fell by 0.2 N a tick."""
    hand = np.array(
        [[wall_n_m, 0, 1, 1e-3, 1, 0, 1000, 3, 1, 8e-3, 0.02, 0.1, 0.7, 3e-3, 0, 0, 0, 1.2, 1, 0, 0, 1, 15]]
    )
    book = books_of(hand, arm_of("phantom_premium_1_5"))[0]
    assert book[LARGEST] > 0.4 * min(3.0, wall_n_m * 4e-3)
    assert book[GAINED] < 0.0


#: What is told of delay and friction: by the device file, other delays, and an arm that need not have any friction.
TOLD = (AS_FILED, Told(0.3e-3), Told(1e-3))


@pytest.mark.parametrize(
    ("name", "told"), [*((each, told) for each in HUNTED_KG for told in TOLD), ("touch_x", Told(0.1e-3, 0.0))]
)
def test_no_hand_that_a_search_finds_gains(name: str, told: Told) -> None:
    """Each has its own delay, jitter and friction, within what the servo is told."""
    found = hunt(name, 1, told=told, first_seed=7, generations=40)
    assert found.hands > 400
    assert found.gaining == 0


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("phantom_premium_1_5", Told(delay_s=0.0, friction=1.0, late_s=0.3e-3)),
        # At 0.3 ms gains begin: a search finds some on one processor and none on another, which rounds otherwise.
        ("touch_x", Told(delay_s=0.0, friction=1.0, late_s=0.5e-3)),
        ("phantom_premium_1_5", Told(delay_s=0.1e-3, friction=1.0, least=0.25)),
        ("touch", Told(delay_s=0.1e-3, friction=1.0, least=0.25)),
        ("grasp_odrive", Told(delay_s=0.0, friction=1.0, late_s=2.5e-3, least=0.25)),
    ],
)
def test_hands_gain_where_less_is_told_than_is_so(name: str, told: Told) -> None:
    """A delay that books do not have, friction that is not there: what all versions assumed before."""
    enough_j = 10.0 * GAIN_J
    assert hunt(name, 2, told=told, generations=40, enough_j=enough_j).most_j > enough_j


@pytest.mark.parametrize(("generations", "share"), by_day([(8, 0.25)], [(GENERATIONS, 0.5)]))
def test_no_pair_of_hands_that_a_search_finds_gains_and_unbounded_many_do(generations: int, share: float) -> None:
    bounded, free = (hunt_pairs(1, bounded=each, first_seed=1, generations=generations) for each in (True, False))
    assert bounded.gaining == 0
    assert free.gaining > share * free.hands
    assert bounded.row().endswith("| 0 | nothing |")


@pytest.mark.long
@pytest.mark.parametrize("name", HUNTED_KG)
def test_no_hand_of_whole_searches_gains(name: str) -> None:
    assert hunt(name, 2, first_seed=100).gaining == 0


@pytest.mark.parametrize("name", MASSES_KG)
def test_slow_hands_feel_walls_as_the_local_model_alone_has_them(name: str) -> None:
    """If forces come at once and the vendor's friction is sure; docs/results/haptics.md has what less costs."""
    soft, middle, stiff = (feel_walls(name, walls, 200, told=Told(0.0, 1.0)) for walls in WALLS_N_M)
    assert soft.law < soft.model + 1e-4
    assert middle.law < middle.model + 0.02
    assert stiff.law < stiff.model + 0.15


def test_the_search_finds_hands_that_gain_where_nothing_bounds_the_energy() -> None:
    assert hunt("phantom_premium_1_5", 1, bounded=False, generations=20, enough_j=1e-3).most_j > 1e-3


def test_the_search_finds_the_top_of_a_hill_that_is_long_and_bent() -> None:
    def hill(points: FloatArray) -> FloatArray:
        x, y = 4.0 * points[:, 0] - 2.0, 4.0 * points[:, 1] - 2.0
        return -(100.0 * (y - x**2) ** 2 + (1.0 - x) ** 2)

    points, height = search(hill, 2, generations=300, seed=1)
    assert height.max() > -1e-4
    np.testing.assert_allclose(points[height.argmax()], 0.75, atol=0.01)
