"""Hands at a wall: the one that drew back fast, and those that a search finds."""

from __future__ import annotations

import numpy as np
import pytest

from services.gateway.device_files import ArmFile
from services.mechanics.arrays import FloatArray
from services.runtime import config
from studies.feel.hunt import MASSES_KG
from studies.feel.search import search
from studies.feel.wall_hands import GAINED, LARGEST, MOVED, RANGES, ArmAtWall, arm_at_wall, books_of, decode


def arm(name: str, *, controller: bool = True) -> ArmAtWall:
    return arm_at_wall(config.load(ArmFile, config.find("device", name))[0], MASSES_KG[name], controller=controller)


GAINS = pytest.mark.xfail(strict=True, reason="a known weakness: force falls by 0.2 N a tick at most")


@pytest.mark.parametrize("wall_n_m", [300.0, pytest.param(1000.0, marks=GAINS), pytest.param(2000.0, marks=GAINS)])
def test_a_hand_that_presses_slowly_and_draws_back_fast_gains_nothing(wall_n_m: float) -> None:
    """A hand of 1,000 N/m, 4 mm, 0.7 m/s: it gains 5 mJ of a wall of 2,000, as force falls by 0.2 N a tick."""
    hand = np.array([[wall_n_m, 0, 1, 1e-3, 1, 0, 1000, 3, 1, 8e-3, 0.02, 0.1, 0.7, 3e-3, 0, 0]])
    book = books_of(hand, arm("phantom_premium_1_5"))[0]
    assert book[LARGEST] > 0.4 * min(3.0, wall_n_m * 4e-3)
    assert book[GAINED] < 0.0


@GAINS
@pytest.mark.parametrize("name", MASSES_KG)
def test_no_hand_that_a_search_finds_gains(name: str) -> None:
    at = arm(name)

    def share(points: FloatArray) -> FloatArray:
        books = books_of(decode(points), at)
        return books[:, GAINED] / np.maximum(books[:, MOVED], 1e-6)

    points, _ = search(share, len(RANGES), generations=40, seed=7)
    assert books_of(decode(points), at)[:, GAINED].max() <= 0.0


def test_the_search_finds_hands_that_gain_where_nothing_bounds_the_energy() -> None:
    at = arm("phantom_premium_1_5", controller=False)
    points, gained = search(lambda p: books_of(decode(p), at)[:, GAINED], len(RANGES), generations=20, seed=0)
    assert gained.max() > 1e-3
    assert len(points) == len(gained)


def test_the_search_finds_the_top_of_a_hill_that_is_long_and_bent() -> None:
    def hill(points: FloatArray) -> FloatArray:
        x, y = 4.0 * points[:, 0] - 2.0, 4.0 * points[:, 1] - 2.0
        return -(100.0 * (y - x**2) ** 2 + (1.0 - x) ** 2)

    points, height = search(hill, 2, generations=300, seed=1)
    assert height.max() > -1e-4
    np.testing.assert_allclose(points[height.argmax()], 0.75, atol=0.01)
