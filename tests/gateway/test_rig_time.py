"""Simulated time: single ticks, each once it is answered; what is behind the clock comes later, or never."""

from __future__ import annotations

from trocar.services.gateway.orders.rig_time import RigTime

MS = 1_000_000


def test_no_tick_is_lost_and_what_is_late_is_caught_up() -> None:
    time = RigTime(MS, simulated=True)
    seen = []
    for due in [*range(5), 15, *range(16, 40)]:  # ten milliseconds in which the gateway was not run
        time.advance(due, due * MS)
        seen.append(time.index)
    assert seen == list(range(len(seen)))
    assert time.is_behind
    k = 40
    while time.is_behind:
        time.advance(k, round((40 + 0.8 * (k - 40)) * MS))  # at 1250 Hz
        seen.append(time.index)
        k += 1
    assert seen == list(range(len(seen)))
    assert 40 < k < 120


def test_a_tick_that_is_not_answered_stands() -> None:
    time = RigTime(MS, simulated=True)
    time.advance(0, 0)
    for k in range(1, 4):
        time.advance(k, k * MS, is_answered=False)
        assert (time.index, time.stands) == (0, True)
    time.advance(4, 4 * MS)
    assert (time.index, time.stands) == (1, False)


def test_what_is_far_behind_is_forgiven_so_that_time_is_slower_than_the_clock() -> None:
    time = RigTime(MS, simulated=True)
    time.advance(0, 0)
    for k in range(1, 1001):
        time.advance(k, k * MS, is_answered=False)
    ticks = 0
    while time.is_behind:
        time.advance(1001 + ticks, 1000 * MS)
        ticks += 1
    assert 40 <= ticks <= 60
    assert time.index == ticks


def test_pause_and_single_steps_are_kept_in_simulated_time() -> None:
    time = RigTime(MS, simulated=True)
    time.advance(0, 0)
    time.pace = 0.0
    for k in range(1, 100):
        time.advance(k, k * MS)
    assert time.index == 0
    time.step(1000)
    for k in range(100, 1300):
        time.advance(k, k * MS)
    assert time.index == 1000
    time.step_soon()
    time.step_soon()
    time.advance(1300, 1300 * MS)
    time.advance(1301, 1301 * MS)
    assert time.index == 1001, "one step, however often it is asked for"


def test_slow_motion_goes_at_its_pace() -> None:
    time = RigTime(MS, simulated=True)
    time.advance(0, 0)
    time.pace = 0.25
    for k in range(1, 401):
        time.advance(k, k * MS)
    assert time.index == 100


def test_at_a_lower_speed_so_many_fewer_ticks_come_and_none_is_owed() -> None:
    time = RigTime(MS, simulated=True)
    time.speed = 0.6
    for k in range(1001):
        time.advance(k, k * MS)
    assert abs(time.index - 600) <= 1
    assert not time.is_behind
