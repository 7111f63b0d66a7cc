"""What a loop reserves: as much as its work needs, never more than is admitted, and not now this and now that."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trocar.services.runtime.realtime.reservation import (
    LONGEST_PAUSE_S,
    MARGIN,
    MEAN_MARGIN,
    MOST,
    PATIENCE_S,
    PAUSE_S,
    QUANTILE,
    STEP,
    Reservation,
    need_of,
    pause_s,
)

LITTLE = 1e-9
TOP = 0.8
#: What the kernel admits in all.
ROOM = 1.2


class Kernel:
    """Admits a loop's share up to what others leave; `now` is what it has admitted."""

    def __init__(self, now: float = 0.0, others: float = 0.0) -> None:
        self.now, self.others = now, others

    def ask(self, share: float) -> bool:
        if share > ROOM - self.others + LITTLE:
            return False
        self.now = share
        return True


def changes(shares: list[float]) -> int:
    return int(np.count_nonzero(np.diff(shares)))


needs = st.integers(1, round(TOP / STEP)).map(lambda steps: steps * STEP)


@given(st.lists(st.integers(10_000, 3_000_000), min_size=1, max_size=300))
def test_what_is_needed_covers_the_work_of_nearly_all_periods_and_its_mean(work_ns: list[int]) -> None:
    found = need_of(np.array(work_ns), 1_000_000)
    assert STEP - LITTLE <= found <= MOST
    assert round(found / STEP) * STEP == pytest.approx(found)
    if found < MOST - LITTLE:
        assert sum(each > found * 1_000_000 + 1 for each in work_ns) <= 1 + (1 - QUANTILE) * len(work_ns)
        assert np.mean(work_ns) <= found * 1_000_000
        assert found < STEP + max(MARGIN, MEAN_MARGIN) * max(work_ns) / 1_000_000


@given(st.integers(1, round(TOP / STEP)), st.lists(st.tuples(needs, st.floats(0.0, 1.0)), min_size=1, max_size=200))
def test_never_more_than_is_admitted_and_never_less_than_the_need_where_that_fits(
    guess: int, seconds: list[tuple[float, float]]
) -> None:
    """What others reserve comes and goes; what this loop has is its own until it gives it back."""
    kernel = Kernel(guess * STEP)
    held = Reservation(kernel.now)
    for second, (each, others) in enumerate(seconds):
        kernel.others = min(ROOM * others, ROOM - kernel.now)
        held.follow(float(second), each, kernel.ask)
        assert held.share == pytest.approx(kernel.now), "what the kernel has is what the loop believes"
        assert held.share <= ROOM - kernel.others + LITTLE
        assert held.short == (each if each > held.share + LITTLE else 0.0)
        assert not held.short or each > ROOM - kernel.others
    kernel.others = 0.0
    held.follow(1e6, each, kernel.ask)
    assert held.share >= each - LITTLE
    assert not held.short


@given(st.integers(2, 30), st.lists(st.integers(0, 1), min_size=400, max_size=400))
def test_a_need_that_wavers_by_a_step_does_not_move_what_is_reserved(base: int, noise: list[int]) -> None:
    kernel = Kernel(0.3)
    held, shares = Reservation(0.3), []
    for second, up in enumerate(noise):
        held.follow(float(second), STEP * (base + up), kernel.ask)
        shares.append(held.share)
    assert changes(shares) <= 2, "the guess, and a step up"


def test_a_pause_lasts_twice_as_long_as_the_last_one_unless_that_was_long_ago() -> None:
    assert pause_s(5.0, 0.0, 0.0) == PAUSE_S
    assert pause_s(101.0, 100.0, PAUSE_S) == 2.0 * PAUSE_S
    assert pause_s(1000.0, 999.0, LONGEST_PAUSE_S) == LONGEST_PAUSE_S
    assert pause_s(1000.0, 999.0 - LONGEST_PAUSE_S, LONGEST_PAUSE_S) == PAUSE_S


def test_a_need_that_comes_and_goes_is_held_longer_and_longer() -> None:
    kernel = Kernel(0.5)
    held, shares = Reservation(0.5), []
    for second in range(3600):
        held.follow(float(second), 0.6 if second % 30 < 5 else 0.3, kernel.ask)
        shares.append(held.share)
    assert changes(shares) <= 12
    assert changes(shares[600:]) == 0
    assert shares[-1] == 0.6


def test_a_guess_is_given_back_at_once_and_more_is_had_at_once() -> None:
    kernel, held = Kernel(0.7), Reservation(0.7)
    for second, (wanted, had) in enumerate([(0.3, 0.3), (0.6, 0.6), *[(0.3, 0.6)] * 3, (0.3, 0.3)]):
        held.follow(float(second), wanted, kernel.ask)
        assert held.share == had


def test_a_loop_waits_for_others_to_give_back_their_guesses() -> None:
    kernel, held = Kernel(0.2, others=0.8), Reservation(0.2)
    for second in range(12):
        held.follow(float(second), 0.8, kernel.ask)
        assert (held.share, held.short) == (0.2, 0.8)
        assert held.is_left_out(float(second)) == (second > 0 and second % PATIENCE_S == 0)
        if held.is_left_out(float(second)):
            held.wait_again(float(second))
    held.drop()
    assert not held.is_left_out(20.0)
    kernel.others = 0.1
    held.follow(40.0, 0.8, kernel.ask)
    assert held.share == 0.8
    assert not held.is_left_out(80.0)
