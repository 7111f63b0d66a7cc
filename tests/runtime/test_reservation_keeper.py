"""The layer between a loop's ring, the decision and the kernel: what is asked for, and what is said."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from services.runtime import reservation_keeper
from services.runtime.loop import LoopMeter, TickClock
from services.runtime.reservation_keeper import ReservationKeeper, ReservationPause, work_per_period
from services.runtime.scheduling import Scheduling, SchedulingRequest


class Granting(Scheduling):
    """A place on the ladder without a kernel: shares up to what is free are admitted."""

    free = 0.9

    def reserve(self, share: float, period_ns: int) -> bool:
        if share > self.free + 1e-9:
            return False
        self._rung, self._period_ns, self.had = 1, period_ns, f"DEADLINE {100 * share:.0f} %"
        return True

    def step_down(self) -> None:
        self._rung, self.had = 2, "nice -20"


def run(meter: LoopMeter, work_ns: Sequence[int]) -> None:
    for tick, each in enumerate(work_ns):
        meter.flight.write(tick, 0, 0, 0, each, ())


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    now_ns = [1]
    monkeypatch.setattr(reservation_keeper.time, "monotonic_ns", lambda: now_ns[0])
    return now_ns


Keeper = Callable[..., tuple[ReservationKeeper, Granting]]


@pytest.fixture
def keeper(tmp_path: Path) -> Keeper:
    tmp_path.chmod(0o700)

    def build(meter: LoopMeter, free: float = 0.9) -> tuple[ReservationKeeper, Granting]:
        place = Granting(SchedulingRequest(80, 0.5), had="DEADLINE 50 %", _rung=1)
        place.free = free
        return ReservationKeeper(place, meter, ReservationPause(tmp_path), logging.getLogger("loop")), place

    return build


def test_it_looks_once_a_second_and_reserves_what_the_ticks_took(clock: list[int], keeper: Keeper) -> None:
    meter = LoopMeter(1000.0)
    kept, place = keeper(meter)
    run(meter, [240_000] * 1000)
    assert not kept.keep()
    clock[0] += 1_000_000_000
    assert kept.keep()
    assert place.had == "DEADLINE 30 %"
    run(meter, [400_000] * 1000)
    assert not kept.keep()
    clock[0] += 1_000_000_000
    assert kept.keep()
    assert (place.had, place._period_ns) == ("DEADLINE 44 %", 1_000_000)


def test_ticks_that_may_take_two_periods_are_counted_together(clock: list[int], keeper: Keeper) -> None:
    meter = LoopMeter(1000.0)
    meter.periods_allowed = 2
    kept, place = keeper(meter)
    run(meter, [10_000, 590_000] * 500)
    assert set(work_per_period(meter.flight, 2)) == {600_000}
    clock[0] += 1_000_000_000
    assert kept.keep()
    assert (place.had, place._period_ns) == ("DEADLINE 38 %", 2_000_000)


def test_work_that_was_caught_up_counts_for_the_ticks_that_it_is_of(clock: list[int], keeper: Keeper) -> None:
    """Late by two ticks again and again, each tick does three: its need is that of a loop in time."""
    meter = LoopMeter(1000.0)
    clock_of_ticks, (kept, place) = TickClock(meter), keeper(meter)
    for tick in range(0, 3000, 3):
        work_ns = 240_000 * clock_of_ticks.steps(tick)
        meter.flight.write(tick, 0, 0, 0, work_ns, ())
    assert work_per_period(meter.flight, 1, catches_up=True)[1:] == pytest.approx(240_000)
    clock[0] += 1_000_000_000
    assert kept.keep()
    assert place.had == "DEADLINE 30 %"


def test_a_tick_that_comes_once_in_two_periods_is_all_their_work(clock: list[int], keeper: Keeper) -> None:
    meter = LoopMeter(1000.0)
    meter.periods_allowed, meter.catches_up = 2, True
    kept, place = keeper(meter)
    for tick in range(0, 2000, 2):
        meter.flight.write(tick, 0, 0, 0, 600_000, ())
    clock[0] += 1_000_000_000
    assert kept.keep()
    assert (place.had, place._period_ns) == ("DEADLINE 38 %", 2_000_000)


def test_ticks_that_were_skipped_are_nobodys_work() -> None:
    meter = LoopMeter(1000.0)
    for tick in range(0, 5000, 5):
        meter.flight.write(tick, 0, 0, 0, 240_000, ())
    assert set(work_per_period(meter.flight, 1, catches_up=True)) == {240_000}  # beyond what is caught up
    assert set(work_per_period(meter.flight, 1)) == {240_000}


def test_where_one_loop_does_not_fit_none_reserves_and_that_is_said_once(
    clock: list[int], keeper: Keeper, caplog: pytest.LogCaptureFixture
) -> None:
    """A loop without a reservation would run only when the others leave it time."""
    meters = LoopMeter(1000.0), LoopMeter(1000.0)
    (large, place), (small, beside) = keeper(meters[0], free=0.6), keeper(meters[1])
    had = []
    for second in range(90):
        for meter, work_ns in zip(meters, (650_000, 240_000), strict=True):
            run(meter, [work_ns] * 1000)
        clock[0] += 1_000_000_000
        large.keep()
        small.keep()
        had.append((place.had, beside.had))
        place.free = 0.6 if second < 40 else 0.9
    assert had[0] == ("DEADLINE 50 %", "DEADLINE 30 %")
    assert had[2] == ("nice -20", "nice -20")
    assert set(had[2:12]) == {("nice -20", "nice -20")}
    assert had[-1] == ("DEADLINE 82 %", "DEADLINE 30 %"), "once there is room, and the pause is over"
    (said,) = [record.getMessage() for record in caplog.records]
    for words in ("no room for 82 % of a core", "no loop of the rig reserves any", "more cores", "lower rung"):
        assert words in said


def test_a_pause_of_another_uptime_does_not_count(clock: list[int], tmp_path: Path) -> None:
    """The file may outlive the machine's clock, which begins anew at every start."""
    tmp_path.chmod(0o700)
    ReservationPause(tmp_path).begin(1e6)
    assert ReservationPause(tmp_path).is_on(1e6 + 5.0)
    assert not ReservationPause(tmp_path).is_on(5.0)


def test_a_loop_that_has_hardly_run_says_nothing_yet(clock: list[int], keeper: Keeper) -> None:
    meter = LoopMeter(1000.0)
    kept, place = keeper(meter)
    run(meter, [10_000] * 20)
    clock[0] += 1_000_000_000
    assert not kept.keep()
    assert place.had == "DEADLINE 50 %"
