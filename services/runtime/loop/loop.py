"""The deadline loop: an absolute grid, no bursts, every tick accounted for."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import trocar.protocol.bodies as bodies
from trocar.protocol import Frame
from trocar.services.runtime.bus.bus import Bus
from trocar.services.runtime.measures.flight import FlightRing
from trocar.services.runtime.measures.histogram import LatencyHistogram


@dataclass(slots=True)
class Tick:
    """One turn of a loop."""

    index: int
    scheduled_ns: int
    started_ns: int


#: Gap between two ticks, in periods, that is reported as a stall.
STALL_PERIODS = 10
#: A stall lasts ten ticks or more, so that hardly more of them fit between two reports.
_STALLS_KEPT = 8


class LoopMeter:
    """Counts of a loop: lateness of the start, work, period, misses, which include ticks that never ran.

    Attributes:
        tick: The present tick of the rig, written by the process in each.
        stages_ns: Duration of each of `stages` in this tick, in ns, likewise; zero by default.
        flight: The last ticks.
        periods_allowed: Periods within which a tick must be done, more than one where it does the work of several.
        catches_up: Whether a tick does the work of those that were lost before it, see `TickClock`.
        beyond_work: Misses that less work would not have avoided: the deadline passed while the thread was not run, by
            the host or for another process, or had nothing to do yet.
    """

    def __init__(self, rate_hz: float, stages: Sequence[str] = ()) -> None:
        self.flight = FlightRing(rate_hz, stages)
        self.tick = 0
        self._no_stages = (0,) * len(self.flight.stages)
        self.stages_ns: Sequence[int] = self._no_stages
        self._ran_ns = 0
        self.rate_hz = rate_hz
        self.period_ns = round(1e9 / rate_hz)
        self.periods_allowed = 1
        self.catches_up = False
        self.ticks = 0
        self.misses = 0
        self.skipped = 0
        self.beyond_work = 0
        self.lateness = LatencyHistogram(self.period_ns)
        self.work = LatencyHistogram(self.period_ns)
        self.period = LatencyHistogram(self.period_ns)
        self.stalls: deque[bodies.Stall] = deque(maxlen=_STALLS_KEPT)
        self._stall_ns = STALL_PERIODS * self.period_ns
        self._stall_count = 0
        self._scheduled_ns = 0
        self._started_ns = 0
        self._alive_ns = 0
        self._worked_ns = 0  # time on a processor for the last tick, since the one before or since it last had no work
        self._away_ns = 0  # recent time on no processor
        self._late_work_ns = 0  # likewise since a tick was on time, or lost ticks were counted
        self._unseen: int | None = None

    def change_rate(self, rate_hz: float) -> None:
        """Change the rate, from the next tick on."""
        if rate_hz != self.rate_hz:
            self.rate_hz = rate_hz
            self.period_ns = round(1e9 / rate_hz)
            self._stall_ns = STALL_PERIODS * self.period_ns

    def start(self, scheduled_ns: int, now_ns: int, unseen: int | None = None) -> None:
        """Count the start of a tick that was due at `scheduled_ns`.

        Of a loop that follows frames, `unseen` is the number of those that were sent since the last tick and not seen.
        """
        self._unseen = unseen
        self.lateness.record(now_ns - scheduled_ns)
        if self._started_ns:
            self.period.record(now_ns - self._started_ns)
            self._away_ns = now_ns - self._started_ns - self._worked_ns
            if now_ns - self._started_ns > self._stall_ns:
                self._stalled(now_ns)
        else:
            self._ran_ns = time.thread_time_ns()
        self._scheduled_ns = scheduled_ns
        self._started_ns = now_ns
        self.stages_ns = self._no_stages

    def finish(self, now_ns: int) -> None:
        """Count the end of the tick, which is a miss after the allowed periods."""
        self.ticks += 1
        self.work.record(now_ns - self._started_ns)
        ran_ns = time.thread_time_ns()
        self._worked_ns, self._ran_ns = ran_ns - self._ran_ns, ran_ns
        self._away_ns = now_ns - self._scheduled_ns - self._worked_ns
        if now_ns - self._scheduled_ns > self.periods_allowed * self.period_ns:
            self._late_work_ns += self._worked_ns
            self._miss(1, self._away_ns // (self.periods_allowed * self.period_ns))
        else:
            self._late_work_ns = 0
        self.flight.write(self.tick, self._scheduled_ns, self._started_ns, now_ns, self._worked_ns, self.stages_ns)

    def idle(self, now_ns: int) -> None:
        """Record that the loop ran at `now_ns` with nothing to do, so that this part of a gap is not its own fault.

        It is behind with nothing then, so what it has worked until now, such as looking again and again, loses no tick.
        """
        if self._started_ns and now_ns - max(self._started_ns, self._alive_ns) > self._stall_ns:
            self._stalled(now_ns)
        self._alive_ns = now_ns
        self._ran_ns, self._late_work_ns = time.thread_time_ns(), 0

    def _stalled(self, now_ns: int) -> None:
        length_ns = now_ns - max(self._started_ns, self._alive_ns)
        if length_ns > self._stall_ns:
            self._stall_count += 1
            self.stalls.append(bodies.Stall(index=self._stall_count, ended_ns=now_ns, length_ns=length_ns))

    def skip(self, ticks: int) -> None:
        """Count ticks that never ran."""
        self.skipped += ticks
        self._lose(ticks)

    def catch_up(self, ticks: int) -> None:
        """Count ticks that ran together with a later one; those beyond the allowed periods are late."""
        self.ticks += ticks
        self._lose(max(ticks + 1 - self.periods_allowed, 0))

    def _lose(self, ticks: int) -> None:
        """Count ticks that were lost between two that ran.

        Own work can have cost only ticks whose frames were sent and not seen: what its clock never sent, it did not
        lose. Nor can it have cost more of them than its time since a tick was on time, however the frames came: a clock
        that stood still sends a late tick before the one whose index tells of the loss. And what was waited since the
        last tick lost whole periods whatever the work.
        """
        since_ns = time.thread_time_ns() - self._ran_ns
        burnt = -(-self._late_work_ns // self.period_ns) + since_ns // self.period_ns
        if self._unseen is not None:
            burnt = min(burnt, self._unseen * self.periods_allowed)
        self._late_work_ns = 0
        self._miss(ticks, max(ticks - burnt, (self._away_ns - since_ns) // self.period_ns))

    def _miss(self, ticks: int, passed: int) -> None:
        """Count misses, of which `passed` were independent of the work."""
        self.misses += ticks
        self.beyond_work += max(0, min(ticks, passed))

    def body(self) -> bodies.LoopReport:
        """Return the counts for the wire."""
        return bodies.LoopReport(
            rate_hz=self.rate_hz,
            ticks=self.ticks,
            misses=self.misses,
            skipped=self.skipped,
            beyond_work=self.beyond_work,
            lateness=self.lateness.body(),
            work=self.work.body(),
            period=self.period.body(),
            stalls=tuple(self.stalls),
        )


def sleep_until(deadline_ns: int) -> None:
    """Sleep to `deadline_ns` of the monotonic clock; returns at once if it has passed."""
    remaining = deadline_ns - time.monotonic_ns()
    if remaining > 0:
        time.sleep(remaining * 1e-9)


def ticks(
    meter: LoopMeter, stop: Callable[[], bool], wait_until: Callable[[int], None] = sleep_until, first: int = 0
) -> Iterator[Tick]:
    """Yield a tick per period on an absolute grid until `stop` returns True.

    The body of the ``for`` is the work of the tick. Work that overruns whole periods loses those ticks: they count as
    skipped and the loop continues at the next point of the grid, never in a burst.

    Args:
        meter: Rate and counts of the loop.
        stop: Called before every tick.
        wait_until: Called to wait for the next point of the grid; it must return at that time (a bus may listen
        meanwhile).
        first: Index of the first tick.
    """
    index = first
    scheduled = time.monotonic_ns() + meter.period_ns
    while not stop():
        wait_until(scheduled)
        now = time.monotonic_ns()
        meter.start(scheduled, now)
        meter.tick = index
        yield Tick(index, scheduled, now)
        now = time.monotonic_ns()
        meter.finish(now)
        behind = max(0, now - scheduled - 1) // meter.period_ns  # work that ends at the next deadline is in time
        if behind > 0:
            meter.skip(behind)
        index += behind + 1
        scheduled += (behind + 1) * meter.period_ns


#: A jump of the rig's clock by up to this many ticks (times the allowed periods) is caught up; a larger one is skipped
#: and counted.
CATCH_UP = 3


class TickClock:
    """Converts tick indices of received frames to steps, as the rig has one clock, the gateway's.

    The same sequence of indices always gives the same steps, independently of times.
    """

    def __init__(self, meter: LoopMeter) -> None:
        self._meter = meter
        meter.catches_up = True
        self._last: int | None = None

    def steps(self, index: int) -> int:
        """Return the number of steps of one period to `index`, 0 if it was seen before.

        A smaller index means that the gateway has restarted: one step, and counting continues from there.
        """
        last, self._last = self._last, index
        if last is None or index < last:
            return 1
        jump = index - last
        if jump > CATCH_UP * self._meter.periods_allowed:
            self._meter.skip(jump - 1)
            return 1
        if jump > 1:
            self._meter.catch_up(jump - 1)
        return jump


#: Largest share of its core that a following loop takes, once it has exceeded it by `_AHEAD_NS`. The kernel throttles
#: all real-time threads that leave less than 5 % of a core for 50 ms in every second.
SHARE = 0.8
#: With `SHARE` that makes 85 % of any second, less than the 95 % at which the kernel throttles.
_AHEAD_NS = 50_000_000
#: A longer tick was not only work: the process was stopped, or waited for its core.
_WORK_NS = 20_000_000


class DutyCycleLimiter:
    """Rest of a loop between ticks, zero if it keeps its rate or only falls behind once."""

    def __init__(self) -> None:
        self._ahead_ns = 0.0
        self._last_ns = 0

    def rest_ns(self, began_ns: int, now_ns: int) -> int:
        """Return the rest after a tick from `began_ns` to `now_ns`."""
        busy_ns, elapsed_ns = min(now_ns - began_ns, _WORK_NS), now_ns - (self._last_ns or began_ns)
        self._last_ns = now_ns
        self._ahead_ns = max(0.0, self._ahead_ns + busy_ns - SHARE * elapsed_ns)
        return round(max(0.0, self._ahead_ns - _AHEAD_NS) / SHARE)


def follow_topic(
    bus: Bus, topic: str, meter: LoopMeter, stop: Callable[[], bool], slack: Callable[[], object] = lambda: None
) -> Iterator[Frame | None]:
    """Yield each new frame of `topic`, only the newest; None if none came for two periods.

    After each tick is done and counted, the bus sends frames that are not urgent, and `slack` is called for background
    work such as reports.

    The tick is due when its frame was sent (or received, from another host), and must be done one period later. Frames
    faster than the rate (a flooding publisher) are answered at no more than three times the rate, and a loop whose
    ticks take longer than their period rests between them (`DutyCycleLimiter`), to leave a part of the core free.
    """
    apart_ns = -(-meter.period_ns // 3)  # the rate that its own readers accept, so that it does not flood them in turn
    last_ns = sequence = 0
    limiter = DutyCycleLimiter()
    while not stop():
        bus.flush()
        slack()
        if not bus.wait(topic, time.monotonic_ns() + 2 * meter.periods_allowed * meter.period_ns):
            meter.idle(time.monotonic_ns())
            yield None
            continue
        sleep_until(last_ns + apart_ns)
        frame = bus.latest(topic)
        if frame is None:  # refused, or a socket readable without a frame, as of a dead publisher
            sleep_until(time.monotonic_ns() + meter.period_ns)
            yield None
            continue
        last_ns = time.monotonic_ns()
        unseen = max(0, frame.sequence - sequence - 1)  # a smaller sequence is that of a new publisher
        sequence = frame.sequence
        meter.start(frame.sent_ns if bus.is_near(topic) else last_ns, last_ns, unseen)
        yield frame
        ended_ns = time.monotonic_ns()
        meter.finish(ended_ns)
        if rest_ns := limiter.rest_ns(last_ns, ended_ns):
            sleep_until(ended_ns + rest_ns)
