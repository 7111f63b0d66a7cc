"""The layer between a loop's ring, the decision and the kernel: what is asked for, and what is said."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from trocar.services.runtime.loop import reservation_keeper
from trocar.services.runtime.loop.loop import LoopMeter, TickClock
from trocar.services.runtime.loop.reservation_keeper import ReservationKeeper, ReservationPause, work_per_period
from trocar.services.runtime.realtime.reservation import need_of
from trocar.services.runtime.realtime.scheduling import Scheduling, SchedulingRequest


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

    def build(meter: LoopMeter, free: float = 0.9, priority: int = 80) -> tuple[ReservationKeeper, Granting]:
        place = Granting(SchedulingRequest(priority, 0.5), had="DEADLINE 50 %", _rung=1)
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


PRIORITIES = (10, 60, 70, 80)


@given(
    needs_ns=st.lists(st.integers(20_000, 600_000), min_size=4, max_size=4),
    room=st.floats(0.3, 1.8),
    order=st.permutations(range(4)),
)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=40)
def test_where_not_all_loops_of_a_rig_have_room_the_most_important_have_it(
    needs_ns: list[int], room: float, order: list[int], tmp_path: Path
) -> None:
    """Whoever came last had none before, also the gateway, and ran only when the others left it time."""
    tmp_path.chmod(0o700)
    (tmp_path / reservation_keeper.PAUSE_FILE).unlink(missing_ok=True)
    now_ns, places, had = [1], list[Sharing](), []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reservation_keeper.time, "monotonic_ns", lambda: now_ns[0])
        meters = [LoopMeter(1000.0) for _ in PRIORITIES]
        keepers = []
        for priority, meter in zip(PRIORITIES, meters, strict=True):
            place = Sharing(SchedulingRequest(priority, 0.02), had="nice -20", _rung=2)
            place.room, place.places = room, places
            places.append(place)
            keepers.append(ReservationKeeper(place, meter, ReservationPause(tmp_path), logging.getLogger("loop")))
        for _ in range(300):
            now_ns[0] += 1_000_000_000
            for which in order:
                run(meters[which], [needs_ns[which]] * 60)
                keepers[which].keep()
            had.append([place.share > 0.0 for place in places])
    wanted = [need_of(np.array([each]), 1_000_000) for each in needs_ns]
    fits = [sum(wanted[k:]) <= room - 1e-6 for k in range(4)]  # those from k on together
    rates = np.mean(had, axis=0)
    for k in range(4):
        if fits[k]:
            assert rates[k] > 0.8, (wanted, rates)
    assert sum(place.share for place in places) <= room + 1e-9


class Sharing(Granting):
    """One of several loops, which have a room together."""

    room, share = 0.0, 0.0
    places: list[Sharing]

    def reserve(self, share: float, period_ns: int) -> bool:
        if sum(each.share for each in self.places if each is not self) + share > self.room + 1e-9:
            return False
        self._rung, self.share = 1, share
        return True

    def step_down(self) -> None:
        super().step_down()
        self.share = 0.0


def test_who_is_left_out_says_so_once_with_what_to_do(
    clock: list[int], keeper: Keeper, caplog: pytest.LogCaptureFixture
) -> None:
    meters = LoopMeter(1000.0), LoopMeter(1000.0)
    (first, place), (second, beside) = keeper(meters[0], free=0.6), keeper(meters[1], priority=60)
    had = []
    for number in range(40):
        for meter, work_ns in zip(meters, (650_000, 240_000), strict=True):
            run(meter, [work_ns] * 1000)
        clock[0] += 1_000_000_000
        first.keep()
        second.keep()
        had.append((place.had, beside.had))
        place.free = 0.6 if number < 6 else 0.9
    assert had[3] == ("DEADLINE 50 %", "DEADLINE 30 %")
    assert had[5] == ("DEADLINE 50 %", "nice -20")
    assert had[8] == ("DEADLINE 82 %", "nice -20")
    assert had[-1] == ("DEADLINE 82 %", "DEADLINE 30 %"), "once the pause is over"
    (said,) = [record.getMessage() for record in caplog.records]
    for words in ("no room for 82 % of a core", "reserve none", "more cores", "lower rung"):
        assert words in said


def test_a_pause_of_another_uptime_does_not_count(clock: list[int], tmp_path: Path) -> None:
    """The file may outlive the machine's clock, which begins anew at every start."""
    tmp_path.chmod(0o700)
    ReservationPause(tmp_path).begin(70, 1e6)
    assert ReservationPause(tmp_path).below(1e6 + 5.0) == 70
    assert ReservationPause(tmp_path).below(1e6 + 15.0) == 0
    assert ReservationPause(tmp_path).below(5.0) == 0


def test_a_loop_that_has_hardly_run_says_nothing_yet(clock: list[int], keeper: Keeper) -> None:
    meter = LoopMeter(1000.0)
    kept, place = keeper(meter)
    run(meter, [10_000] * 20)
    clock[0] += 1_000_000_000
    assert not kept.keep()
    assert place.had == "DEADLINE 50 %"
