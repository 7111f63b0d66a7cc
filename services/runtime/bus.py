"""The bus as a process sees it, and the bookkeeping of every kind of bus: order, incarnations, ages, refusals."""

from __future__ import annotations

import secrets
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

import msgspec

import protocol
import protocol.bodies as bodies
from protocol import Frame, FrameError, Reason, Topic
from services.runtime import frame_batches
from services.runtime.clocks import ClockOffset
from services.runtime.histogram import LatencyHistogram

#: A reader accepts up to this many times the topic's rate; what comes faster is refused undecoded.
FLOOD_FACTOR = 3.0
#: The burst that a reader forgives: a stopped publisher that is continued sends what its queues held.
FLOOD_BURST = 100.0
#: So many frames beyond that rate, by the publisher's own numbers and times, are a flood: at four times 1 kHz after
#: 50 ms. Who keeps the newest only would else never see one.
FLOOD_FRAMES = 50.0
#: Of a reader of every frame of a fast topic, which is held up and catches up: so many seconds of them.
BACKLOG_S = 30.0
FAR_NS = 1_000_000  # half of a round trip, from which on a topic that is sampled is read all the time
#: Frames taken by one `drain`: what is beyond waits for the next, so that a loop's time stays bounded.
DRAIN_LIMIT = 256


class Bus(Protocol):
    """What a process may do with the bus. One thread uses it."""

    def publish(
        self, topic: str, body: msgspec.Struct, *, origin_ns: int = 0, valid: bool = True, at_once: bool = False
    ) -> int:
        """Send `body` to whoever reads `topic`; return the sequence number. Never blocks.

        Frames leave when the process sleeps; ``at_once`` is for one that somebody waits for, in the middle of a tick.
        """

    def flush(self) -> None:
        """Send what nobody waits for: to be called between two ticks, in each. Never blocks."""

    def latest(self, topic: str) -> Frame | None:
        """Return the newest frame of a "latest" topic that was not returned before, or None. Never blocks."""

    def drain(self, topic: str) -> list[Frame]:
        """Return the frames of a topic read with ``every`` since the last call, oldest first. Never blocks."""

    def batch(self, topic: str) -> Batch | None:
        """Return the next unread frames of a topic read with ``every``, unchecked, or None. Never blocks."""

    def sample(self, topics: Iterable[str], until_ns: int) -> dict[str, Frame]:
        """Ask for one frame each of topics opened as ``samples``; wait for them, but not beyond `until_ns`.

        Between two samples nothing is sent to this process: for readers that want some frames of a fast topic.
        """

    def wait(self, topic: str, until_ns: int) -> bool:
        """Sleep until `topic` may have a frame (True) or the monotonic clock reaches `until_ns` (False)."""

    def is_fresh(self, *topics: str) -> bool:
        """Return whether the last frame of each topic was valid and is for certain younger than ``stale_after_s``."""

    def is_near(self, topic: str) -> bool:
        """Return whether `topic` is published by the clock of this host."""

    def has_reader(self, topic: str) -> bool:
        """Return whether a reader of `topic`, which this process publishes, has subscribed."""

    def gauges(self) -> dict[str, float]:
        """Return who was refused for want of the rig's keys, and what is known of other hosts' clocks."""

    def reports(self) -> tuple[bodies.TopicReport, ...]:
        """Return the counts of every topic of this process."""

    on_flood: Callable[[], None]
    """Called when a publisher begins to flood a topic that is read, and while it goes on."""

    def floods(self) -> dict[str, int]:
        """Return how many frames beyond `FLOOD_FACTOR` times its rate were seen, of each topic that was flooded."""

    def close(self) -> None:
        """Give up all sockets and locks."""


class Outbox:
    """Numbers and seals the frames of one published topic."""

    def __init__(self, row: Topic, incarnation: int) -> None:
        self.row = row
        self.incarnation = incarnation
        self.sent = 0

    def seal(self, body: msgspec.Struct, origin_ns: int, valid: bool) -> bytes:
        """Return the bytes of the next frame."""
        row = self.row
        frame = Frame(
            protocol.PROTOCOL_VERSION, row.name, row.version, self.incarnation, self.sent,
            time.monotonic_ns(), origin_ns, valid, body,
        )  # fmt: skip
        self.sent += 1
        return protocol.encode(frame)

    def report(self) -> bodies.TopicReport:
        """Return the counts as they travel."""
        return bodies.TopicReport(topic=self.row.name, sent=self.sent)


class Inbox:
    """Checks the frames of one read topic: who sent them, in which order, how old, and whether they may be used."""

    clock: ClockOffset | None = None  # of another host: frames are returned in this host's time

    def __init__(self, row: Topic, *, every: bool = False, on_flood: Callable[[], None] = lambda: None) -> None:
        self.row = row
        self.beyond_rate = 0  # frames of a publisher that floods
        self._on_flood = on_flood
        self._excess = 0.0
        self._is_refusing = False
        self._counted = (0, 0)  # number and time of the frame up to which that is
        self.every = every or row.delivery == "every"
        self.received = 0
        self.superseded = 0
        self.dropped = 0
        self.refused: Counter[str] = Counter()
        self.age = LatencyHistogram(round(1e9 / row.rate_hz))
        self.last: Frame | None = None
        self._retired: deque[int] = deque(maxlen=16)
        self._used = not every  # who reads every frame of a fast topic keeps or shows it
        self._burst = max(FLOOD_BURST, BACKLOG_S * row.rate_hz) if every else FLOOD_BURST
        self._tokens = self._burst
        self._refilled_ns = time.monotonic_ns()

    def accept(self, data: bytes) -> Frame | None:
        """Return the frame in `data` if it may be used, else None with the reason counted."""
        now = time.monotonic_ns()
        if self._refilled(now) < 1.0:
            self.refused[Reason.FLOOD] += 1
            self._is_refusing = True  # which may be this reader's lateness
            return None
        self._tokens -= 1.0
        frame = self._decoded(data)
        if frame is not None:
            self._count(frame, 1, now)
        return frame if frame is None or self.is_near else self._here(frame, now)

    def accept_all(self, batch: Sequence[bytes]) -> list[Frame]:
        """Return the frames of `batch` that may be used; of the others the reasons are counted."""
        now = time.monotonic_ns()
        within = self._within_rate(now, len(batch))
        if within < len(batch):
            self.refused[Reason.FLOOD] += len(batch) - within
            self._is_refusing = True  # which may be this reader's lateness
        frames = [frame for data in batch[:within] if (frame := self._decoded(data)) is not None]
        if frames:
            self._count(frames[-1], len(frames), now)
        return frames if self.is_near else [self._here(frame, now) for frame in frames]

    @property
    def is_near(self) -> bool:
        """Whether its publisher has the clock of this host."""
        return self.clock is None or self.clock.ours

    @property
    def is_far(self) -> bool:
        """Whether its publisher's host is, or may be, so far away that a question and its answer take milliseconds."""
        clock = self.clock
        return clock is not None and not (clock.known and clock.uncertainty_ns(time.monotonic_ns()) < FAR_NS)

    def _here(self, frame: Frame, now_ns: int) -> Frame:
        """Return a frame of another host in our time: as if sent now, for no sample, while its clock is not known."""
        clock = self.clock
        if clock is None or not clock.known:
            return msgspec.structs.replace(frame, sent_ns=now_ns, origin_ns=0)
        origin_ns = clock.here_ns(frame.origin_ns) if frame.origin_ns else 0
        return msgspec.structs.replace(frame, sent_ns=min(now_ns, clock.here_ns(frame.sent_ns)), origin_ns=origin_ns)

    def _age_ns(self, frame: Frame, now_ns: int) -> tuple[int, int] | None:
        """Return the age of a frame as it came and by how much it may be off, None if its host's clock is not known."""
        clock = self.clock
        if clock is None or clock.ours:
            return now_ns - frame.sent_ns, 0
        return (now_ns - clock.here_ns(frame.sent_ns), clock.uncertainty_ns(now_ns)) if clock.known else None

    def _decoded(self, data: bytes) -> Frame | None:
        """Return the frame in `data`, from now on the last, if it may be used, else None with the reason counted."""
        try:
            frame = protocol.decode(data, self.row.name, used=self._used)
            self._order(frame)
        except FrameError as error:
            self.refused[error.reason] += 1
            return None
        self.last = frame
        return frame

    def _count(self, last: Frame, n: int, now: int) -> None:
        """Count `n` frames of which `last` is the last; after refused ones see whether their publisher floods."""
        self.received += n
        age = self._age_ns(last, now)
        if age is not None:
            self.age.record(age[0])
        if self._is_refusing:
            self._is_refusing = False
            self._look_for_flood(last)

    def is_fresh(self, now_ns: int) -> bool:
        """Return whether the last frame may still be acted on; one from the future is of a clock that nobody knows."""
        last = self.last
        age = None if last is None or not last.valid else self._age_ns(last, now_ns)
        return age is not None and 0 <= age[0] + age[1] <= self.row.stale_after_s * 1e9

    def report(self) -> bodies.TopicReport:
        """Return the counts as they travel."""
        return bodies.TopicReport(
            topic=self.row.name,
            received=self.received,
            superseded=self.superseded,
            dropped=self.dropped,
            refused={str(reason): count for reason, count in self.refused.items()},
            age=self.age.body(),
        )

    def _within_rate(self, now_ns: int, wanted: int) -> int:
        """Return how many of the `wanted` frames may be taken now."""
        taken = min(wanted, int(self._refilled(now_ns)))
        self._tokens -= taken
        return taken

    def _refilled(self, now_ns: int) -> float:
        """Return how many frames may be taken now, of which a part may be in sight only."""
        refill = (now_ns - self._refilled_ns) * 1e-9 * self.row.rate_hz * FLOOD_FACTOR
        self._tokens = min(self._burst, self._tokens + refill)
        self._refilled_ns = now_ns
        return self._tokens

    def _order(self, frame: Frame) -> None:
        last = self.last
        if last is None:
            self._counted = frame.sequence, frame.sent_ns
            return
        if frame.incarnation == last.incarnation:
            gap = frame.sequence - last.sequence - 1
            if gap < 0:
                raise FrameError(Reason.OUT_OF_ORDER, f"sequence {frame.sequence} after {last.sequence}")
            if self.every:
                self.dropped += gap
            elif gap:
                self.superseded += gap
                self._look_for_flood(frame)
            return
        if frame.incarnation in self._retired:
            raise FrameError(Reason.OLD_INCARNATION, f"{frame.incarnation} was replaced")
        self._retired.append(last.incarnation)
        self._counted = frame.sequence, frame.sent_ns

    def _look_for_flood(self, frame: Frame) -> None:
        """Compare the publisher's numbers with its times: how late this reader is plays no part."""
        n_sent, passed_ns = frame.sequence - self._counted[0], frame.sent_ns - self._counted[1]
        self._counted = frame.sequence, frame.sent_ns
        allowed = max(0, passed_ns) * 1e-9 * self.row.rate_hz * FLOOD_FACTOR
        self._excess = max(0.0, self._excess + n_sent - allowed)
        if self._excess > FLOOD_FRAMES:
            self.beyond_rate += int(self._excess)
            self._excess = 0.0
            self._on_flood()


@dataclass(frozen=True, slots=True)
class Batch:
    """Frames as they came, one after the other, and their lengths as 32-bit integers."""

    lengths: bytes
    data: bytes
    inbox: Inbox

    def frames(self) -> list[Frame]:
        """Return those that may be used; of the others the reasons are counted."""
        return self.inbox.accept_all(frame_batches.split(self.lengths, self.data))


def floods(inboxes: dict[str, Inbox]) -> dict[str, int]:
    """Return the frames beyond the rate of each topic that was flooded."""
    return {name: box.beyond_rate for name, box in inboxes.items() if box.beyond_rate}


def new_incarnation() -> int:
    """Return the number that tells this start of a process from all others."""
    return secrets.randbits(48)


def summarise(outboxes: dict[str, Outbox], inboxes: dict[str, Inbox]) -> tuple[bodies.TopicReport, ...]:
    """Return the reports of all topics of a process."""
    return (*(box.report() for box in outboxes.values()), *(box.report() for box in inboxes.values()))
