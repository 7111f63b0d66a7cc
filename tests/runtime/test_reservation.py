"""What a loop reserves: as much as its work needs, never more than is admitted, and not now this and now that."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.runtime.reservation import (
    LEAST_MARGIN,
    MARGIN,
    MOST,
    QUANTILE,
    SPARE,
    STEP,
    Need,
    Reservation,
    need_of,
)

LITTLE = 1e-9
TOP = 0.8
#: What the kernel admits in all.
ROOM = 1.2


class Kernel:
    """Admits a loop's share up to what others leave; `now` is what it has admitted."""

    def __init__(self, now: float = 0.0, others: float = 0.0) -> None:
        self.now, self.others, self.asked = now, others, 0

    def ask(self, share: float) -> bool:
        self.asked += 1
        if share > ROOM - self.others + LITTLE:
            return False
        self.now = share
        return True


def need(share: float, least: float | None = None) -> Need:
    """Return a need whose mean is a little below the least."""
    least = share if least is None else least
    return Need(share, least, least / 1.05)


def changes(shares: list[float]) -> int:
    return int(np.count_nonzero(np.diff(shares)))


needs = st.tuples(st.integers(2, round(TOP / STEP)), st.integers(1, round(TOP / STEP))).map(
    lambda pair: need(STEP * max(pair), STEP * min(pair))
)


@given(st.lists(st.integers(10_000, 3_000_000), min_size=1, max_size=300))
def test_what_is_needed_covers_the_work_of_nearly_all_periods_and_its_mean(work_ns: list[int]) -> None:
    found = need_of(np.array(work_ns), 1_000_000)
    assert STEP - LITTLE <= found.least <= found.share <= MOST
    assert round(found.share / STEP) * STEP == pytest.approx(found.share)
    if found.share < MOST - LITTLE:
        assert sum(each > found.share * 1_000_000 + 1 for each in work_ns) <= 1 + (1 - QUANTILE) * len(work_ns)
        assert found.usual <= found.least
        assert found.share < STEP + max(MARGIN, LEAST_MARGIN) * max(work_ns) / 1_000_000


@given(st.integers(1, round(TOP / STEP)), st.lists(st.tuples(needs, st.floats(0.0, 1.0)), min_size=1, max_size=200))
def test_never_more_than_is_admitted_and_never_less_than_the_need_where_that_fits(
    guess: int, seconds: list[tuple[Need, float]]
) -> None:
    """What others reserve comes and goes; what this loop has is its own until it gives it back."""
    kernel = Kernel(guess * STEP)
    held = Reservation(kernel.now)
    for second, (each, others) in enumerate(seconds):
        kernel.others = min(ROOM * others, ROOM - kernel.now)
        held.follow(float(second), each, kernel.ask)
        assert held.share == pytest.approx(kernel.now), "what the kernel has is what the loop believes"
        assert held.share <= ROOM - kernel.others + LITTLE
        if held.short:
            assert held.share < each.share
        if each.least <= ROOM - kernel.others - SPARE and held._again_s < second:
            assert held.share >= each.least - LITTLE
    kernel.others = 0.0
    held.follow(1e6, each, kernel.ask)
    assert held.share >= each.share - LITTLE
    assert not held.short


@given(st.integers(2, 30), st.lists(st.integers(0, 1), min_size=400, max_size=400))
def test_a_need_that_wavers_by_a_step_does_not_move_what_is_reserved(base: int, noise: list[int]) -> None:
    kernel = Kernel(0.3)
    held, shares = Reservation(0.3), []
    for second, up in enumerate(noise):
        held.follow(float(second), need(STEP * (base + up), STEP), kernel.ask)
        shares.append(held.share)
    assert changes(shares) <= 2, "the guess, and a step up"


@given(st.floats(0.0, 1.0), st.lists(needs, min_size=4, max_size=4))
def test_loops_beside_each_other_come_to_rest_and_share_what_there_is(free: float, wanted: list[Need]) -> None:
    """Of loops of constant need none moves any more after a few minutes, and who fits is not left out."""
    total = 0.5 + 1.3 * free
    loops = [Reservation(0.0) for _ in wanted]
    kernels = [Kernel() for _ in wanted]
    told = []
    for second in range(1200):
        for held, kernel, each in zip(loops, kernels, wanted, strict=True):
            kernel.others = ROOM - (total - sum(other.now for other in kernels if other is not kernel))
            held.follow(float(second), each, kernel.ask)
            if held.gives_up(float(second), each):
                kernel.now = 0.0
        told.append([held.share for held in loops])
        assert sum(told[-1]) <= total + LITTLE
    moved = np.count_nonzero(np.diff(np.array(told[600:]), axis=0), axis=0)
    if sum(each.share for each in wanted) <= total - SPARE:
        assert all(held.share >= each.least - LITTLE for held, each in zip(loops, wanted, strict=True))
        assert not moved.any()
    assert moved.max() <= 24, "who has no room comes to see, and lets others try, ever more seldom"


def test_a_need_that_comes_and_goes_is_held_longer_and_longer() -> None:
    kernel = Kernel(0.5)
    held, shares = Reservation(0.5), []
    for second in range(3600):
        held.follow(float(second), need(0.6 if second % 30 < 5 else 0.3), kernel.ask)
        shares.append(held.share)
    assert changes(shares) <= 12
    assert changes(shares[600:]) == 0
    assert shares[-1] == 0.6


def test_a_guess_is_given_back_at_once_and_more_is_had_at_once() -> None:
    kernel, held = Kernel(0.7), Reservation(0.7)
    for second, (wanted, had) in enumerate([(0.3, 0.3), (0.6, 0.6), *[(0.3, 0.6)] * 3, (0.3, 0.3)]):
        held.follow(float(second), need(wanted), kernel.ask)
        assert held.share == had


def test_where_room_is_scarce_it_falls_back_to_its_mean_and_tries_for_more_ever_more_seldom() -> None:
    kernel, held = Kernel(0.5, others=0.3), Reservation(0.5)
    wanted, shares = need(0.5, 0.3), []
    held.follow(0.0, wanted, kernel.ask)
    assert held.share == 0.5
    kernel.others = 0.48  # 0.02 are left
    for second in range(1, 1000):
        held.follow(float(second), wanted, kernel.ask)
        shares.append(held.share)
    assert shares[0] == shares[-1] == 0.3
    assert held.short == 0.5
    assert kernel.asked <= 1100
    kernel.others = 0.3
    held.follow(1000.0, wanted, kernel.ask)
    assert held.share == 0.5
    assert not held.short


def test_a_loop_whose_mean_work_does_not_fit_waits_for_others_gives_up_and_comes_back() -> None:
    """A loop that stands still in most of its periods is better off in the next class."""
    kernel, held = Kernel(0.2, others=0.8), Reservation(0.2)
    wanted, shares = need(0.8, 0.52), list[float]()
    for second in range(4):
        held.follow(float(second), wanted, kernel.ask)
        held.gives_up(float(second), wanted)
        shares.append(held.share)
    assert shares == [0.2, 0.0, 0.0, 0.0], "for a second others may fall back"
    for second, others, share in ((6, 0.75, 0.0), (30, 0.65, 0.52), (100, 0.1, 0.8)):
        kernel.others = others
        held.follow(float(second), wanted, kernel.ask)
        assert held.share == pytest.approx(share)
        assert not held.gives_up(second + 0.5, wanted)


def test_a_smaller_need_is_asked_for_at_once() -> None:
    """As where the scene has taken a lower rung of its quality."""
    kernel, held = Kernel(0.2, others=0.8), Reservation(0.2)
    held.follow(0.0, need(0.8), kernel.ask)
    assert held.gives_up(1.0, need(0.8))
    held.follow(1.5, need(0.3), kernel.ask)
    assert held.share == pytest.approx(0.3)
