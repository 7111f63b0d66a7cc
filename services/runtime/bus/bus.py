"""Interface of the bus, and the bookkeeping of all its implementations: order, incarnations, ages, refusals."""

from __future__ import annotations

import secrets
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

import msgspec

import trocar.protocol.bodies as bodies
from trocar import protocol
from trocar.protocol import Frame, FrameError, Reason, Topic
from trocar.protocol.topics import HEARTBEAT_S
from trocar.services.runtime.bus import frame_batches
from trocar.services.runtime.bus.clocks import ClockOffset
from trocar.services.runtime.measures.histogram import LatencyHistogram

#: A reader accepts up to this many times the topic's rate; further frames are refused undecoded.
FLOOD_FACTOR = 3.0
#: Accepted burst, as a stopped and continued publisher sends the content of its queues.
FLOOD_BURST = 100.0
#: Frames beyond that rate, by the publisher's own numbers and times, that are a flood: at four times 1 kHz after 50 ms.
#: A reader of only the newest frames could not detect one otherwise.
FLOOD_FRAMES = 50.0
#: Seconds of frames that a delayed reader of every frame of a fast topic may catch up: as many as the recorder can keep
#: waiting for a slow disk. Of all four 1 kHz topics they take 213 MB in a file (benchmarks/results/recorder.md).
BACKLOG_S = 30.0
#: No publisher sends more frames of a topic in a second: a greater step of the sequence was not made by sending.
FASTEST_HZ = 1e6
#: Silence after which a process is taken to be gone, as the supervisor does by default: one that it had replaced may
#: come back then. Another sequence of the same process is followed once its last frame is no longer fresh.
GONE_S = HEARTBEAT_S
FAR_NS = 1_000_000  # half a round trip from which a sampled topic is read all the time
#: Most frames of one `drain`, to bound a loop's time; the others wait for the next.
DRAIN_LIMIT = 256


class Bus(Protocol):
    """Interface of the bus for a process; not thread-safe."""

    def publish(
        self, topic: str, body: msgspec.Struct, *, origin_ns: int = 0, valid: bool = True, at_once: bool = False
    ) -> int:
        """Send `body` to the readers of `topic`; return the sequence number. Never blocks.

        Frames leave when the process sleeps; ``at_once`` is for a frame in the middle of a tick for which a reader
        waits.
        """

    def flush(self) -> None:
        """Send frames that are not urgent; call this between any two ticks. Never blocks."""

    def latest(self, topic: str) -> Frame | None:
        """Return the newest frame of a "latest" topic that was not returned before, or None. Never blocks."""

    def drain(self, topic: str) -> list[Frame]:
        """Return the frames of a topic read with ``every`` since the last call, oldest first. Never blocks."""

    def batch(self, topic: str) -> Batch | None:
        """Return the next unread frames of a topic read with ``every``, unchecked, or None. Never blocks."""

    def sample(self, topics: Iterable[str], until_ns: int) -> dict[str, Frame]:
        """Request one frame each of topics opened as ``samples``, and wait for them until `until_ns`.

        Between two samples nothing is sent to this process. This is for readers of some frames of a fast topic.
        """

    def wait(self, topic: str, until_ns: int) -> bool:
        """Sleep until `topic` may have a frame (True) or the monotonic clock reaches `until_ns` (False)."""

    def is_fresh(self, *topics: str) -> bool:
        """Return whether the last frame of each topic was valid and is certainly younger than ``stale_after_s``."""

    def is_near(self, topic: str) -> bool:
        """Return whether the publisher of `topic` uses this host's clock."""

    def has_reader(self, topic: str) -> bool:
        """Return whether a reader of `topic`, which this process publishes, has subscribed."""

    def gauges(self) -> dict[str, float]:
        """Return the number of peers refused without the rig's keys, and the offsets of other hosts' clocks."""

    def reports(self) -> tuple[bodies.TopicReport, ...]:
        """Return the counts of every topic of this process."""

    on_flood: Callable[[], None]
    """Called when a publisher starts to flood a read topic, and while it continues."""

    def floods(self) -> dict[str, int]:
        """Return the number of frames beyond `FLOOD_FACTOR` times the rate, of each flooded topic."""

    def close(self) -> None:
        """Release all sockets and locks."""


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
        """Return the counts for the wire."""
        return bodies.TopicReport(topic=self.row.name, sent=self.sent)


class Inbox:
    """Checks the frames of one read topic: sender, order, age, and validity."""

    clock: ClockOffset | None = None  # of another host, to return frames in this host's time

    def __init__(self, row: Topic, *, every: bool = False, on_flood: Callable[[], None] = lambda: None) -> None:
        self.row = row
        self.beyond_rate = 0  # frames of a flood
        self._on_flood = on_flood
        self._excess = 0.0
        self._is_refusing = False
        self._counted = (0, 0)  # number and time of the last frame counted in that
        self.every = every or row.delivery == "every"
        self.received = 0
        self.superseded = 0
        self.dropped = 0
        self.refused: Counter[str] = Counter()
        self.age = LatencyHistogram(round(1e9 / row.rate_hz))
        self.last: Frame | None = None
        self._retired: deque[int] = deque(maxlen=16)
        self._begun_ns = self._heard_ns = 0  # first and last frame of the sender that is followed, by this host's clock
        self._used = not every  # a reader of every frame only stores or shows it
        self._burst = max(FLOOD_BURST, BACKLOG_S * row.rate_hz) if every else FLOOD_BURST
        self._tokens = self._burst
        self._refilled_ns = time.monotonic_ns()

    def accept(self, data: bytes) -> Frame | None:
        """Return the frame in `data` if it is valid, else None, counting the reason."""
        now = time.monotonic_ns()
        if self._refilled(now) < 1.0:
            self.refused[Reason.FLOOD] += 1
            self._is_refusing = True  # which may be this reader's lateness
            return None
        self._tokens -= 1.0
        frame = self._decoded(data, now)
        if frame is not None:
            self._count(frame, 1, now)
        return frame if frame is None or self.is_near else self._here(frame, now)

    def accept_all(self, batch: Sequence[bytes]) -> list[Frame]:
        """Return the valid frames of `batch`, counting the reasons of the others."""
        now = time.monotonic_ns()
        within = self._within_rate(now, len(batch))
        if within < len(batch):
            self.refused[Reason.FLOOD] += len(batch) - within
            self._is_refusing = True  # which may be this reader's lateness
        frames = [frame for data in batch[:within] if (frame := self._decoded(data, now)) is not None]
        if frames:
            self._count(frames[-1], len(frames), now)
        return frames if self.is_near else [self._here(frame, now) for frame in frames]

    @property
    def is_near(self) -> bool:
        """Whether its publisher uses this host's clock."""
        return self.clock is None or self.clock.ours

    @property
    def is_far(self) -> bool:
        """Whether a round trip to its publisher takes, or may take, milliseconds."""
        clock = self.clock
        return clock is not None and not (clock.known and clock.uncertainty_ns(time.monotonic_ns()) < FAR_NS)

    def _here(self, frame: Frame, now_ns: int) -> Frame:
        """Return a frame of another host in our time; with an unknown clock, as sent now and without an origin."""
        clock = self.clock
        if clock is None or not clock.known:
            return msgspec.structs.replace(frame, sent_ns=now_ns, origin_ns=0)
        origin_ns = clock.here_ns(frame.origin_ns) if frame.origin_ns else 0
        return msgspec.structs.replace(frame, sent_ns=min(now_ns, clock.here_ns(frame.sent_ns)), origin_ns=origin_ns)

    def _age_ns(self, frame: Frame, now_ns: int) -> tuple[int, int] | None:
        """Return the age of a received frame and its uncertainty, None if its host's clock is unknown."""
        clock = self.clock
        if clock is None or clock.ours:
            return now_ns - frame.sent_ns, 0
        return (now_ns - clock.here_ns(frame.sent_ns), clock.uncertainty_ns(now_ns)) if clock.known else None

    def _decoded(self, data: bytes, now_ns: int) -> Frame | None:
        """Return the frame in `data` and store it as the last, if it is valid; else None, counting the reason."""
        try:
            frame = protocol.decode(data, self.row.name, used=self._used)
            self._order(frame, now_ns)
        except FrameError as error:
            self.refused[error.reason] += 1
            return None
        self.last, self._heard_ns = frame, now_ns
        return frame

    def _count(self, last: Frame, n: int, now: int) -> None:
        """Count `n` frames ending with `last`; after refused ones check whether their publisher floods."""
        self.received += n
        age = self._age_ns(last, now)
        if age is not None:
            self.age.record(age[0])
        if self._is_refusing:
            self._is_refusing = False
            self._look_for_flood(last)

    def is_fresh(self, now_ns: int) -> bool:
        """Return whether the last frame may still be acted on; one from the future is of an unknown clock."""
        last = self.last
        age = None if last is None or not last.valid else self._age_ns(last, now_ns)
        return age is not None and 0 <= age[0] + age[1] <= self.row.stale_after_s * 1e9

    def report(self) -> bodies.TopicReport:
        """Return the counts for the wire."""
        return bodies.TopicReport(
            topic=self.row.name,
            received=self.received,
            superseded=self.superseded,
            dropped=self.dropped,
            refused={str(reason): count for reason, count in self.refused.items()},
            age=self.age.body(),
        )

    def _within_rate(self, now_ns: int, wanted: int) -> int:
        """Return how many of the `wanted` frames may be accepted now."""
        taken = min(wanted, int(self._refilled(now_ns)))
        self._tokens -= taken
        return taken

    def _refilled(self, now_ns: int) -> float:
        """Return the number of frames that may be accepted now, fractions included."""
        refill = (now_ns - self._refilled_ns) * 1e-9 * self.row.rate_hz * FLOOD_FACTOR
        self._tokens = min(self._burst, self._tokens + refill)
        self._refilled_ns = now_ns
        return self._tokens

    def _order(self, frame: Frame, now_ns: int) -> None:
        """Raise FrameError if a frame is not the next of the sender that is followed, nor the first of its successor.

        Nobody keeps that place by what a single frame says, such as a forged sequence or incarnation: once the sender
        is silent there is nothing left to protect, and the next young frame is followed.
        """
        last = self.last
        if last is None:
            self._follow_sender(frame, now_ns)
        elif frame.incarnation != last.incarnation:
            if frame.incarnation in self._retired and not self._may_replace(frame, now_ns, GONE_S):
                raise FrameError(Reason.OLD_INCARNATION, f"{frame.incarnation} was replaced")
            self._retired.append(last.incarnation)
            self._follow_sender(frame, now_ns)
        elif 0 <= (gap := frame.sequence - last.sequence - 1) <= self._longest_gap(now_ns):
            self._skip(frame, gap)
        elif self._may_replace(frame, now_ns, self.row.stale_after_s):
            self._follow_sender(frame, now_ns)
        else:
            raise FrameError(Reason.OUT_OF_ORDER, f"sequence {frame.sequence} after {last.sequence}")

    def _follow_sender(self, frame: Frame, now_ns: int) -> None:
        """Take a frame as the first of the sender that is followed from now on."""
        self._begun_ns = now_ns
        self._counted = frame.sequence, frame.sent_ns
        if frame.incarnation in self._retired:
            self._retired.remove(frame.incarnation)

    def _skip(self, frame: Frame, gap: int) -> None:
        """Count the frames that are missing before this one."""
        if self.every:
            self.dropped += gap
        elif gap:
            self.superseded += gap
            self._look_for_flood(frame)

    def _longest_gap(self, now_ns: int) -> float:
        """Return how many frames the sender can have sent since its first one here, and before, into its queues."""
        return BACKLOG_S * self.row.rate_hz + (now_ns - self._begun_ns) * 1e-9 * FASTEST_HZ

    def _may_replace(self, frame: Frame, now_ns: int, silence_s: float) -> bool:
        """Return whether the sender that is followed has been silent for so long, and the frame is a young one."""
        fresh_ns = self.row.stale_after_s * 1e9
        age = self._age_ns(frame, now_ns)
        is_young = age is None or -age[1] <= age[0] <= fresh_ns + age[1]
        return is_young and now_ns - self._heard_ns > max(fresh_ns, silence_s * 1e9)

    def _look_for_flood(self, frame: Frame) -> None:
        """Compare the publisher's numbers with its times, which does not depend on this reader's lateness."""
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
    """Concatenated frames, unchecked, and their lengths as 32-bit integers."""

    lengths: bytes
    data: bytes
    inbox: Inbox

    def frames(self) -> list[Frame]:
        """Return the valid frames, counting the reasons of the others."""
        return self.inbox.accept_all(frame_batches.split(self.lengths, self.data))


def floods(inboxes: dict[str, Inbox]) -> dict[str, int]:
    """Return the number of frames beyond the rate of each flooded topic."""
    return {name: box.beyond_rate for name, box in inboxes.items() if box.beyond_rate}


def new_incarnation() -> int:
    """Return a number that identifies this start of a process."""
    return secrets.randbits(48)


def summarise(outboxes: dict[str, Outbox], inboxes: dict[str, Inbox]) -> tuple[bodies.TopicReport, ...]:
    """Return the reports of all topics of a process."""
    return (*(box.report() for box in outboxes.values()), *(box.report() for box in inboxes.values()))
