"""The loop keeps to an absolute grid, counts what it loses, and never catches up in a burst."""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator
from dataclasses import replace

import pytest

from tests.memory_bus import MemoryBus, MemoryHub
from trocar.protocol import TOPICS, bodies
from trocar.services.runtime.loop import loop
from trocar.services.runtime.loop.loop import SHARE, DutyCycleLimiter, LoopMeter, TickClock, follow_topic, ticks


class Clock:
    """A clock that moves only when it is told to."""

    def __init__(self) -> None:
        self.now = 1_000_000_000

    def monotonic_ns(self) -> int:
        return self.now

    def thread_time_ns(self) -> int:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += round(seconds * 1e9)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(loop, "time", clock)
    return clock


def after(turns: int) -> Iterator[bool]:
    return itertools.chain([False] * turns, itertools.repeat(True))


def test_a_tick_is_due_on_the_grid_whatever_the_work_took(clock: Clock) -> None:
    meter, stop = LoopMeter(1000.0), after(50)
    starts = []
    for tick in ticks(meter, lambda: next(stop)):
        starts.append(tick.started_ns)
        clock.now += (tick.index * 37) % 900 * 1000  # work of 0 to 0.9 ms
    assert {b - a for a, b in itertools.pairwise(starts)} == {1_000_000}
    assert (meter.ticks, meter.misses, meter.skipped) == (50, 0, 0)
    assert (meter.period.total, meter.period.max_ns, meter.lateness.max_ns) == (49, 1_000_000, 0)
    assert meter.work.sum_ns == sum(index * 37 % 900 * 1000 for index in range(50))


def test_lost_ticks_are_counted_not_caught_up(clock: Clock) -> None:
    meter, stop = LoopMeter(1000.0), after(10)
    seen = []
    for tick in ticks(meter, lambda: next(stop)):
        seen.append((tick.index, tick.started_ns))
        if len(seen) == 3:
            clock.now += 5_300_000  # one tick of 5.3 ms: itself late, five that never ran
    indices = [index for index, _ in seen]
    assert indices == [0, 1, 2, 8, 9, 10, 11, 12, 13, 14]
    assert min(b[1] - a[1] for a, b in itertools.pairwise(seen)) == 1_000_000
    assert (meter.ticks, meter.skipped, meter.misses) == (10, 5, 6)


def test_work_of_exactly_one_period_is_in_time(clock: Clock) -> None:
    meter, stop = LoopMeter(1000.0), after(4)
    for _ in ticks(meter, lambda: next(stop)):
        clock.now += 1_000_000
    assert (meter.ticks, meter.misses, meter.skipped) == (4, 0, 0)


def test_work_of_a_little_more_than_one_period_loses_the_next_tick(clock: Clock) -> None:
    meter, stop = LoopMeter(1000.0), after(4)
    for _ in ticks(meter, lambda: next(stop)):
        clock.now += 1_000_001
    assert (meter.ticks, meter.misses, meter.skipped) == (4, 8, 4)


def test_a_tick_that_does_the_work_of_two_may_take_two_periods() -> None:
    meter = LoopMeter(1000.0)
    for allowed, took_ns, misses in ((1, 1_000_001, 1), (2, 2_000_000, 1), (2, 2_000_001, 2), (1, 1_000_000, 2)):
        meter.periods_allowed = allowed
        meter.start(5_000_000, 5_100_000)
        meter.finish(5_000_000 + took_ns)
        assert meter.misses == misses


def test_stepping_the_wall_clock_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Only the monotonic clock is ever asked: a wall clock that leaps cannot matter."""

    def forbidden() -> float:
        raise AssertionError("somebody asked the wall clock")

    monkeypatch.setattr(time, "time", forbidden)
    monkeypatch.setattr(time, "time_ns", forbidden)
    row = TOPICS["gateway.state"]
    monkeypatch.setitem(TOPICS, "gateway.state", replace(row, stale_after_s=600.0))  # a busy machine may look late
    hub = MemoryHub()
    sender, reader = MemoryBus(hub, publishes=["gateway.state"]), MemoryBus(hub, reads=["gateway.state"])
    meter, stop = LoopMeter(1000.0), after(5)
    for tick in ticks(meter, lambda: next(stop)):
        sender.publish("gateway.state", bodies.GatewayState(tick=tick.index))
        assert reader.latest("gateway.state") is not None
        assert reader.is_fresh("gateway.state")


@pytest.mark.parametrize(
    ("indices", "steps", "skipped"),
    [
        ([5, 6, 7], [1, 1, 1], 0),
        ([5, 5, 6], [1, 0, 1], 0),
        ([5, 7, 10], [1, 2, 3], 0),
        ([5, 9, 10], [1, 1, 1], 3),
        ([500, 0, 1], [1, 1, 1], 0),
    ],
    ids=["each", "seen twice", "caught up", "leap", "gateway restarted"],
)
def test_one_step_per_index_of_the_rigs_clock(indices: list[int], steps: list[int], skipped: int) -> None:
    meter = LoopMeter(1000.0)
    clock = TickClock(meter)
    assert [clock.steps(index) for index in indices] == steps
    assert meter.skipped == skipped


@pytest.mark.parametrize(
    ("indices", "steps", "misses", "skipped"),
    [
        ([4, 6, 8], [1, 2, 2], 0, 0),
        ([4, 8, 10], [1, 4, 2], 2, 0),
        ([4, 10, 18], [1, 6, 1], 11, 7),
    ],
    ids=["each second", "one lost", "three lost, then a leap"],
)
def test_ticks_that_one_does_the_work_of_are_not_late(
    indices: list[int], steps: list[int], misses: int, skipped: int
) -> None:
    meter = LoopMeter(1000.0)
    meter.periods_allowed = 2
    clock = TickClock(meter)
    assert [clock.steps(index) for index in indices] == steps
    assert (meter.misses, meter.skipped) == (misses, skipped)
    assert meter.ticks + skipped + len(indices) == indices[-1] - indices[0] + 1  # each of its own is counted elsewhere


def test_a_follower_answers_each_frame_and_breathes_without_any() -> None:
    hub = MemoryHub()
    sender, reader = MemoryBus(hub, publishes=["gateway.state"]), MemoryBus(hub, reads=["gateway.state"])
    meter, stop = LoopMeter(1000.0), after(6)
    answered = []
    for index, frame in enumerate(follow_topic(reader, "gateway.state", meter, lambda: next(stop))):
        answered.append(frame.body.tick if frame else None)
        if index % 2 == 0:
            sender.publish("gateway.state", bodies.GatewayState(tick=index))
    assert answered == [None, 0, None, 2, None, 4]
    assert meter.ticks == 3


def test_a_follower_breathes_while_what_comes_is_refused(clock: Clock) -> None:
    """Garbage at any rate is answered by health reports at the loop's own, not by silence or a spin."""
    hub = MemoryHub()
    reader = MemoryBus(hub, reads=["gateway.state"])
    meter, stop = LoopMeter(1000.0), after(5)
    began_ns = clock.now
    for _frame in follow_topic(
        reader, "gateway.state", meter, lambda: hub.send("gateway.state", b"garbage") or next(stop)
    ):
        assert _frame is None
    assert clock.now - began_ns >= 5_000_000


def rested(work_ns: int, ticks: int, period_ns: int = 1_000_000) -> tuple[int, int]:
    """Return how long a loop rests and how long it took, if each of its ticks works for `work_ns`."""
    limiter, now, rested = DutyCycleLimiter(), 0, 0
    for _ in range(ticks):
        began = now
        now += work_ns
        rest = limiter.rest_ns(began, now)
        rested += rest
        now += max(rest, period_ns - work_ns, 0)
    return rested, now


def test_an_overloaded_follower_leaves_its_share_of_the_core() -> None:
    rest, took = rested(1_500_000, 10_000)
    assert rest / took == pytest.approx(1.0 - SHARE, rel=0.02)


@pytest.mark.parametrize("work_ns", [100_000, 790_000])
def test_a_follower_that_keeps_its_rate_never_rests(work_ns: int) -> None:
    assert rested(work_ns, 10_000)[0] == 0


def test_one_long_tick_is_no_overload() -> None:
    """The process was stopped for a second: it goes on at once."""
    limiter = DutyCycleLimiter()
    assert limiter.rest_ns(0, 300_000) == 0
    assert limiter.rest_ns(1_000_000, 1_001_000_000) == 0
    assert limiter.rest_ns(1_002_000_000, 1_002_300_000) == 0


def test_a_stall_is_told_with_its_length_by_the_loop_that_had_it(clock: Clock) -> None:
    meter, stop = LoopMeter(1000.0), after(40)
    for tick in ticks(meter, lambda: next(stop)):
        clock.now += {3: 9_000_000, 12: 21_000_000, 33: 400_000_000}.get(tick.index, 100_000)
    told = [(stall.index, stall.length_ns) for stall in meter.body().stalls]
    assert told == [(1, 21_000_000), (2, 400_000_000)]


def test_a_loop_that_had_nothing_to_follow_did_not_stall(clock: Clock) -> None:
    meter = LoopMeter(1000.0)
    meter.start(clock.now, clock.now)
    for _ in range(50):  # looked every 2 ms, for 100 ms
        clock.now += 2_000_000
        meter.idle(clock.now)
    meter.start(clock.now, clock.now + 500_000)
    assert meter.body().stalls == ()
    meter.idle(clock.now + 31_000_000)  # it looked 30 ms too late
    (stall,) = meter.body().stalls
    assert stall.length_ns == 30_500_000


def test_only_the_newest_stalls_travel(clock: Clock) -> None:
    meter = LoopMeter(1000.0)
    for k in range(20):
        meter.start(clock.now, clock.now + k * 50_000_000)
    assert [stall.index for stall in meter.body().stalls] == list(range(12, 20))


def test_a_loop_goes_on_at_another_rate_from_the_next_tick(clock: Clock) -> None:
    meter, stop = LoopMeter(1000.0), after(6)
    began = []
    for tick in ticks(meter, lambda: next(stop)):
        began.append(tick.started_ns)
        if tick.index == 2:
            meter.change_rate(500.0)
    assert [b - a for a, b in itertools.pairwise(began)] == [1_000_000] * 2 + [2_000_000] * 3
    assert meter.body().rate_hz == 500.0
    assert meter.misses == 0
