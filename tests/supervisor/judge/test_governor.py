"""The governor against simulated loads, pure functions of time: what it gives up, and that it never oscillates."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from itertools import pairwise

import pytest

from trocar.services.runtime.loop.quality_governor import Hysteresis
from trocar.services.supervisor.judge.contracts import Breach
from trocar.services.supervisor.judge.enforcement import Action, ActionKind, Enforcement, Ladder
from trocar.services.supervisor.judge.governor import Governor, Level

LEVELS = (
    Level("full", 400.0, 0.5, 0.5),
    Level("fewer sweeps", 390.0, 4.0, 1.0),
    Level("dry", 250.0, 1.0, 2.0),
    Level("dry, fewer sweeps", 200.0, 5.0, 2.5),
)
STEP_S = 0.5


def play(slowness: Callable[[float], float], seconds: float, levels: tuple[Level, ...] = LEVELS) -> list[tuple]:
    """Return each step of the ladder as (time, rung, level) on a machine so many times slower; a tick has 600 us."""
    enforcement = Enforcement(Ladder(levels=levels))
    steps, burnt_s = [], -math.inf
    for k in range(round(seconds / STEP_S)):
        now_s = k * STEP_S
        if slowness(now_s) * (enforcement.governor.rung.cost_us or 0.0) > 600.0:
            burnt_s = now_s
        burning = now_s - burnt_s < 1.0  # what windows and hysteresis of a breach keep
        breach = Breach("physics", "physics ticks", "ticks lost", 2.0, severe=False, sudden=True)
        action = enforcement.decide(now_s, [breach] if burning else [])
        if action is not None:
            burnt_s = -math.inf  # windows are judged anew
            steps.append((now_s, action.kind, enforcement.level))
    return steps


def test_the_rung_that_frees_most_time_for_least_error_is_taken() -> None:
    governor = Governor(LEVELS)
    governor.lower()
    assert governor.rung.name == "dry"
    governor.lower()
    assert governor.rung.name == "dry, fewer sweeps"
    assert not governor.can_lower


def test_where_nobody_has_measured_the_ladder_is_walked_rung_by_rung() -> None:
    governor = Governor([Level(str(k)) for k in range(4)])
    walked = []
    while governor.can_lower:
        governor.lower()
        walked.append(governor.level)
    assert walked == [1, 2, 3]


def test_time_for_an_error_within_rounding_is_free() -> None:
    governor = Governor([Level("a", 100.0, 1.0, 0.0), Level("b", 90.0, 1.0, 0.0), Level("c", 20.0, 2.0, 0.0)])
    governor.lower()
    assert governor.rung.name == "b"


def test_it_acts_within_seconds_and_comes_back_the_way_it_came() -> None:
    steps = play(lambda t: 2.6 if 10.0 <= t < 100.0 else 1.0, 600.0)
    assert [(rung, level) for _, rung, level in steps[:3]] == [
        (ActionKind.LOWER, 2),
        (ActionKind.LOWER, 3),
        (ActionKind.RAISE, 2),
    ]
    assert steps[1][0] < 20.0
    assert [(rung, level) for t, rung, level in steps if t > 100.0] == [(ActionKind.RAISE, 2), (ActionKind.RAISE, 0)]


@pytest.mark.parametrize("slowness", [1.6, 2.0, 2.3, 2.5, 2.9])
def test_under_a_load_that_stays_it_tries_ever_more_rarely(slowness: float) -> None:
    hour_s = 3600.0
    steps = play(lambda t: slowness, hour_s)
    tries = [t for t, rung, _ in steps if rung is ActionKind.RAISE]
    assert len(tries) <= math.log2(hour_s / Hysteresis().calm_s)
    waits = [b - a for a, b in pairwise(tries)]
    assert all(later > 1.8 * earlier for earlier, later in pairwise(waits))


@pytest.mark.parametrize("period_s", [0.3, 1.0, 3.0, 10.0, 30.0, 60.0, 100.0, 200.0])
def test_a_load_that_comes_and_goes_does_not_drive_it(period_s: float) -> None:
    steps = play(lambda t: 2.0 if t % period_s < 0.5 * period_s else 1.0, 7200.0)
    tries = [t for t, rung, _ in steps if rung is ActionKind.RAISE]
    assert len(tries) <= math.log2(7200.0 / Hysteresis().calm_s) + 1


@pytest.mark.parametrize("seed", range(8))
def test_any_load_moves_it_less_often_than_once_in_a_calm(seed: int) -> None:
    """Slowness changes at random times; between two returns lies at least the calm, and after each the ladder holds."""
    drawn = random.Random(seed)
    plan = [drawn.uniform(0.8, 3.5) for _ in range(4000)]
    steps = play(lambda t: plan[int(t / 7.0)], 7200.0)
    tries = [t for t, rung, _ in steps if rung is ActionKind.RAISE]
    assert all(b - a >= Hysteresis().calm_s - STEP_S for a, b in pairwise(tries))
    levels = [0, *(level for *_, level in steps)]
    assert all(0 <= level < len(LEVELS) for level in levels)
    assert len(steps) <= 4 * math.log2(7200.0 / Hysteresis().calm_s) + 2 * len(LEVELS)


def test_a_try_that_has_held_makes_the_next_sooner_again() -> None:
    governor = Governor(LEVELS, Hysteresis(calm_s=10.0, trial_s=30.0))
    governor.lower()
    governor.calm(0.0)
    assert governor.calm(10.0)
    assert governor.come_back(10.0)
    governor.burns(15.0)
    governor.lower()
    assert governor.wait_s == 20.0
    assert not governor.calm(15.0)
    assert governor.calm(35.0)
    assert governor.come_back(35.0)
    governor.calm(66.0)
    assert governor.wait_s == 10.0


def test_a_try_that_fails_goes_back_to_the_rung_that_held_not_to_the_one_that_frees_most_for_its_error() -> None:
    governor = Governor(LEVELS)
    governor.lower(by_far=True)
    way = [governor.level]
    while governor.come_back(1000.0 * len(way)):
        way.append(governor.level)
        governor.calm(1000.0 * len(way) - 1.0)  # it has held
    assert way == [3, 2, 1, 0]
    held = Governor(LEVELS)
    held.lower(by_far=True)
    for now_s in (0.0, 1000.0, 2000.0):
        held.come_back(now_s)
    assert held.level == 0
    held.burns(2003.0, spent_s=40.0)
    held.lower()
    assert held.level == 1
    assert held.wait_s == 160.0


def test_one_stall_of_the_machine_gives_nothing_up() -> None:
    """Its windows are over before patience is, sudden as it was."""
    assert play(lambda t: 9.0 if 10.0 <= t < 11.0 else 1.0, 60.0) == []


def test_what_is_told_names_time_and_error() -> None:
    enforcement = Enforcement(Ladder(levels=LEVELS))
    breach = Breach("physics", "physics ticks", "physics: 60 ticks lost", 2.0, severe=False, sudden=True)
    actions = [action for k in range(40) if (action := enforcement.decide(0.1 * k, [breach])) is not None]
    assert actions == [
        Action(
            ActionKind.LOWER,
            "physics",
            "physics: 60 ticks lost; now 'dry', 150 us less a tick, force off by 1 %, motion by 2 %",
        )
    ]
