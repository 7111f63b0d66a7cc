"""Of ticks that a loop loses, those that less work would have spared are told from all others."""

from __future__ import annotations

import time
from collections.abc import Iterable

import pytest

from tests.memory_bus import MemoryBus, MemoryHub
from tests.runtime.loop.test_loop import Clock, after
from trocar.protocol import bodies
from trocar.services.runtime.loop import loop
from trocar.services.runtime.loop.loop import LoopMeter, TickClock, follow_topic, ticks


class Processor(Clock):
    """A clock beside one of the thread's own: time passes with and without work."""

    def __init__(self) -> None:
        super().__init__()
        self.worked = 0

    def thread_time_ns(self) -> int:
        return self.worked

    def work(self, ms: float) -> None:
        self.worked += round(ms * 1e6)
        self.now += round(ms * 1e6)

    def wait(self, ms: float) -> None:
        self.now += round(ms * 1e6)


@pytest.fixture
def processor(monkeypatch: pytest.MonkeyPatch) -> Processor:
    processor = Processor()
    monkeypatch.setattr(loop, "time", processor)
    return processor


@pytest.mark.parametrize(
    ("work_ms", "wait_ms", "lost", "beyond"),
    [
        (0.3, 0.0, 0, 0),
        (5.4, 0.0, 5, 0),
        (0.3, 49.0, 49, 49),
        (0.6, 0.7, 1, 0),
        (2.5, 2.2, 4, 2),
    ],
    ids=["in time", "own work", "the host stood still", "half of the core, where less work helps", "both"],
)
def test_a_lost_tick_is_the_works_where_less_of_it_would_have_spared_it(
    processor: Processor, work_ms: float, wait_ms: float, lost: int, beyond: int
) -> None:
    """Of a tick on the grid: the host stands still before its work is done."""
    meter, stop = LoopMeter(1000.0), after(40)
    for tick in ticks(meter, lambda: next(stop)):
        processor.work(work_ms if tick.index == 20 else 0.1)
        processor.wait(wait_ms if tick.index == 20 else 0.0)
    assert (meter.misses - meter.skipped, meter.misses) == (int(lost > 0), lost + int(lost > 0))
    assert meter.beyond_work == beyond + int(wait_ms >= 1.0), "the tick itself, and those that never ran"


@pytest.mark.parametrize("is_late", [True, False], ids=["the loop was not run", "nobody told it to"])
def test_ticks_that_a_loop_slept_through_are_no_works(processor: Processor, is_late: bool) -> None:
    """Of a loop that follows frames: 30 of them, or the time to make them, are lost between two of its ticks."""
    meter = LoopMeter(1000.0)
    clock = TickClock(meter)
    for index in (0, 1, 2, 32, 33):
        sent = 1_000_000_000 + index * 1_000_000
        processor.now = sent
        if index == 32 and is_late:
            processor.wait(0.9)
        meter.start(sent, processor.now)
        clock.steps(index)
        processor.work(0.4)
        meter.finish(processor.now)
    assert meter.skipped == 29
    assert meter.beyond_work == meter.skipped
    assert meter.misses == meter.skipped + is_late


@pytest.mark.parametrize("late_ms", [0.3, 2.6], ids=["in time", "long, as nothing was at hand"])
@pytest.mark.parametrize("tick", [3, 54], ids=["its late tick first", "the next at once"])
def test_a_loop_that_looks_in_vain_while_its_clock_stands_still_loses_nothing_by_it(
    processor: Processor, tick: int, late_ms: float
) -> None:
    """The gateway stood still for 50 ms; physics looked every 2 ms, and what that took counted as lost by its work."""
    meter = LoopMeter(1000.0)
    clock, began = TickClock(meter), processor.now
    for index, sent_ms, work_ms in ((1, 0.0, 0.3), (2, 1.0, 0.3), (tick, 52.0, late_ms), (55, 55.0, 0.3)):
        while processor.now + 2_000_000 < began + round(sent_ms * 1e6):
            processor.wait(1.7)
            processor.work(0.3)
            meter.idle(processor.now)
        processor.now = max(processor.now, began + round(sent_ms * 1e6))
        meter.start(processor.now, processor.now, unseen=0)
        clock.steps(index)
        processor.work(work_ms)
        meter.finish(processor.now)
    assert meter.misses >= 51
    assert meter.misses - meter.beyond_work == int(late_ms > 1.0), "the late tick itself"


@pytest.mark.parametrize("is_sent", [False, True], ids=["its clock stood still", "it did not look"])
def test_only_frames_that_were_sent_can_be_lost_by_work(processor: Processor, is_sent: bool) -> None:
    hub = MemoryHub()
    sender, reader = MemoryBus(hub, publishes=["gateway.state"]), MemoryBus(hub, reads=["gateway.state"])
    meter, stop = LoopMeter(1000.0), after(2)
    clock = TickClock(meter)
    sender.publish("gateway.state", bodies.GatewayState(tick=0))
    processor.now = time.monotonic_ns()
    for frame in follow_topic(reader, "gateway.state", meter, lambda: next(stop)):
        assert frame is not None
        clock.steps(frame.body.tick)
        if frame.body.tick:
            break
        processor.work(6.0)
        for tick in range(1 if is_sent else 20, 21):
            sender.publish("gateway.state", bodies.GatewayState(tick=tick))
    assert meter.misses == 20, "that of 6 ms, and those after it"
    assert meter.misses - meter.beyond_work == (1 + 6 if is_sent else 1)


Turn = tuple[int, float, float]


def _followed(processor: Processor, turns: Iterable[Turn], between_ms: float = 0.0) -> tuple[int, int]:
    """Return the misses of a loop that follows frames, and those beyond its work.

    A turn is the index of a frame, when it is sent, and the work on it, in ms; `between_ms` is worked after each.
    """
    meter = LoopMeter(1000.0)
    clock, began = TickClock(meter), processor.now
    for index, sent_ms, work_ms in turns:
        sent = began + round(sent_ms * 1e6)
        processor.now = max(processor.now, sent)
        meter.start(sent, processor.now)
        clock.steps(index)
        processor.work(work_ms)
        meter.finish(processor.now)
        processor.work(between_ms)
    return meter.misses, meter.beyond_work


@pytest.mark.parametrize(
    "late",
    [
        [(3, 2.0, 0.3), (58, 57.0, 0.3)],
        [(3, 56.2, 0.3), (58, 57.0, 0.3)],
        [(3, 56.9, 0.3), (58, 57.0, 0.3)],
        [(3, 31.0, 0.3), (33, 56.5, 0.3), (58, 57.0, 0.3)],
        [(3, 31.0, 0.3), (4, 56.5, 0.3), (58, 57.0, 0.3)],
    ],
    ids=["no frame", "a late frame", "two at once", "late twice", "late twice, and not skipped at once"],
)
def test_ticks_that_its_clock_lost_are_no_works_however_the_frames_come(processor: Processor, late: list[Turn]) -> None:
    """Where the gateway's late tick came before the one that had skipped, they counted as the work of physics."""
    turns = [(0, -1.0, 0.3), (1, 0.0, 0.3), (2, 1.0, 0.3), *late, (59, 58.0, 0.3)]
    misses, beyond = _followed(processor, turns)
    assert misses >= 53
    assert beyond == misses


@pytest.mark.parametrize(
    ("turns", "between_ms", "misses", "beyond"),
    [
        ([(1, 0.0, 55.4), (56, 55.4, 0.3), (57, 56.0, 0.3)], 0.0, 55, 0),
        ([(1, 0.0, 55.4), (2, 55.4, 0.3), (57, 56.0, 0.3)], 0.0, 55, 54),
        ([(k * 4 // 3, k * 1.333, 1.333) for k in range(90)], 0.0, 119, 0),
        ([(k * 2, k * 2.0, 0.6) for k in range(2)], 1.4, 1, 0),
    ],
    ids=["one long tick", "long beside a clock that stood still", "always too long", "between its ticks"],
)
def test_ticks_that_a_following_loop_burns_are_its_works(
    processor: Processor, turns: list[Turn], between_ms: float, misses: int, beyond: int
) -> None:
    assert _followed(processor, turns, between_ms) == (misses, beyond)


def test_a_loop_that_is_always_late_is_no_cause_of_what_its_clock_loses_meanwhile(processor: Processor) -> None:
    """Its work since the last loss has burnt a tick or two, not all that it has burnt in its life."""
    overloaded = [(k * 4 // 3, k * 1.333, 1.333) for k in range(90)]
    _, beyond = _followed(processor, [*overloaded, (119, 169.0, 1.333), (171, 171.0, 0.3)])
    assert 45 <= beyond <= 51


def test_a_loop_whose_work_takes_longer_than_its_period_loses_by_its_work(processor: Processor) -> None:
    meter = LoopMeter(1000.0)
    clock = TickClock(meter)
    for _ in range(200):
        index = (processor.now - 1_000_000_000) // 1_000_000
        meter.start(1_000_000_000 + index * 1_000_000, processor.now)
        clock.steps(index)
        processor.work(1.3)
        meter.finish(processor.now)
    assert meter.misses > 200
    assert meter.beyond_work == 0
