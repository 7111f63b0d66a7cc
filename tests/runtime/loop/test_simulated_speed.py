"""Simulated time makes room for the picture of a browser that draws on the processor, and takes it back."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from trocar.services.runtime.loop.simulated_speed import LEAST_PICTURES_HZ, LEAST_SPEED, SPEEDS, SpeedGovernor

#: Shares of one core: what the loops take at full speed, and what the rest of a rig takes at any.
LOOPS, REST, CORES = 1.0, 0.35, 2.0


def pictures_hz(speed: float, cost_s: float, asked_hz: float = 20.0) -> float:
    """Return the pictures of a browser that gets what is left of the cores, where one picture takes so long."""
    return min(asked_hz, (CORES - REST - LOOPS * speed) / cost_s)


def three_seconds(seen: list[float]) -> Iterator[tuple[float, float, float]]:
    """Return three seconds in a row, over which an attempt's pictures are judged."""
    return zip(seen, seen[1:], seen[2:], strict=False)


def follow(
    governor: SpeedGovernor, cost_s: float, seconds: int, begins_s: float = 0.0, *, is_played: bool = True
) -> list[float]:
    """Let a page tell what it shows four times a second; return the pictures it showed in each second."""
    seen = []
    for second in range(seconds):
        shown = pictures_hz(governor.speed, cost_s)
        seen.append(shown)
        for quarter in range(4):
            now_s = begins_s + second + 0.25 * quarter
            governor.take_pictures(now_s, shown, is_played=is_played)
            governor.forget_silent_page(now_s)
    return seen


@pytest.mark.parametrize("cost_s", [0.03, 0.055, 0.07, 0.08])
def test_a_hand_sees_enough_pictures_from_the_first_second_if_any_speed_allows_it(cost_s: float) -> None:
    governor = SpeedGovernor()
    seen = follow(governor, cost_s, 200)
    assert pictures_hz(SPEEDS[-1], cost_s) >= LEAST_PICTURES_HZ
    assert min(a + b + c for a, b, c in three_seconds(seen[1:])) >= 3.0 * LEAST_PICTURES_HZ, seen
    assert governor.speed > LEAST_SPEED


def test_time_is_no_slower_than_the_picture_needs() -> None:
    fast, weak = SpeedGovernor(), SpeedGovernor()
    follow(fast, 0.02, 60)
    follow(weak, 0.06, 60)
    assert fast.speed == 1.0
    assert SPEEDS[-1] < weak.speed < 1.0


def test_a_page_with_a_graphics_processor_is_at_full_speed_within_a_second() -> None:
    governor = SpeedGovernor()
    for quarter in range(4):
        governor.take_pictures(100.0 + 0.25 * quarter, 30.0, is_played=False)
    assert governor.speed == 1.0


def test_what_a_page_shows_of_a_scene_at_rest_says_nothing_of_room() -> None:
    governor = SpeedGovernor()
    follow(governor, 0.02, 60, is_played=False)
    assert governor.speed == SPEEDS[-1]
    follow(governor, 0.02, 60, begins_s=60.0)
    assert governor.speed == 1.0


def test_full_speed_comes_back_once_there_is_room() -> None:
    governor = SpeedGovernor()
    follow(governor, 0.08, 10)
    assert governor.speed == SPEEDS[-1]
    follow(governor, 0.02, 60, begins_s=10.0)
    assert governor.speed == 1.0


def test_without_a_page_time_is_that_of_the_clock_and_what_was_learned_stays() -> None:
    governor = SpeedGovernor()
    governor.forget_silent_page(0.0)
    assert governor.speed == 1.0
    follow(governor, 0.08, 10)
    governor.forget_silent_page(11.0)
    assert governor.speed == SPEEDS[-1]
    governor.forget_silent_page(14.0)
    assert governor.speed == 1.0
    follow(governor, 0.08, 1, begins_s=20.0)
    assert governor.speed == SPEEDS[-1]


def test_unknown_pictures_change_nothing() -> None:
    governor = SpeedGovernor()
    for second in range(20):
        governor.take_pictures(float(second), -1.0, is_played=True)
    assert governor.speed == 1.0
