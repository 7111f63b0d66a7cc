"""What each client of the view gets: always the newest frame, never a queue."""

from __future__ import annotations

import asyncio
import time
from dataclasses import dataclass, field

from services.runtime.health import LatencyPath

#: Frames on their way to a client that has not yet said that it painted them. A tunnel with a round trip of 100 ms
#: still gets 60 pictures a second; a client that stands still (a hidden tab) is sent nothing and wakes to the newest.
IN_FLIGHT = 6


@dataclass(slots=True)
class FeedMessage:
    """A frame, and the hello that a client needs to read it."""

    epoch: int
    hello: str
    sequence: int
    origin_ns: int
    data: bytes


@dataclass(slots=True, eq=False)
class Feed:
    """One client: a slot for the newest message, and what it acknowledged."""

    painted: LatencyPath
    newest: FeedMessage | None = None
    notice: str | None = None
    epoch: int = -1
    in_flight: int = IN_FLIGHT
    origins: dict[int, int] = field(default_factory=dict)
    superseded: int = 0
    wanted_hz: float | None = None
    due_ns: int = 0
    wake: asyncio.Event = field(default_factory=asyncio.Event)

    def offer(self, message: FeedMessage) -> None:
        """Put `message` in the slot; what still was there is lost. What comes more often than is wanted is left out."""
        if self.wanted_hz is not None and message.epoch == self.epoch:
            now_ns, period_ns = time.monotonic_ns(), round(1e9 / self.wanted_hz)
            if now_ns < self.due_ns - period_ns // 8:  # pictures have a grid of their own: a little early is on time
                return
            self.due_ns = (now_ns if now_ns - self.due_ns > period_ns else self.due_ns) + period_ns
        if self.newest is not None:
            self.superseded += 1
        self.newest = message
        self.wake.set()

    def want(self, hz: float | None) -> None:
        """Take how many pictures a second the client can take; None: all."""
        self.wanted_hz = hz
        self.due_ns = 0

    def tell(self, notice: str) -> None:
        """Put a text message beside the slot; only the newest is kept."""
        self.notice = notice
        self.wake.set()

    def begin_anew(self) -> None:
        """Forget what was sent: the client is another one, which knows nothing yet."""
        self.epoch = -1
        self.origins.clear()
        self.wake.set()

    async def next(self) -> list[str | bytes]:
        """Wait for something that may be sent now, and return it: notice, hello, frame."""
        while True:
            parts = self._take()
            if parts:
                return parts
            self.wake.clear()
            await self.wake.wait()

    def acknowledge(self, sequence: int) -> None:
        """Take the client's word that it painted `sequence`: measures the whole path and lets more frames go."""
        origin_ns = self.origins.get(sequence)
        if origin_ns is None:
            return
        for sent in [s for s in self.origins if s <= sequence]:
            del self.origins[sent]
        self.painted.answered += 1
        if origin_ns:
            self.painted.latency.record(time.monotonic_ns() - origin_ns)
        self.wake.set()

    def _take(self) -> list[str | bytes]:
        parts: list[str | bytes] = []
        if self.notice is not None:
            parts.append(self.notice)
            self.notice = None
        message = self.newest
        if message is None or len(self.origins) >= self.in_flight:
            return parts
        self.newest = None
        if message.epoch != self.epoch:
            self.epoch = message.epoch
            parts.append(message.hello)
        self.origins[message.sequence] = message.origin_ns
        self.painted.asked += 1
        parts.append(message.data)
        return parts


class Feeds:
    """All clients."""

    def __init__(self, painted: LatencyPath) -> None:
        self.painted = painted
        self.open: set[Feed] = set()
        self._notice: str | None = None

    def __len__(self) -> int:
        return len(self.open)

    def wanted_hz(self) -> float | None:
        """Return how many pictures a second the fastest client wants; None: all there are, or there is no client."""
        wanted = [feed.wanted_hz for feed in self.open]
        known = [hz for hz in wanted if hz is not None]
        return max(known) if known and len(known) == len(wanted) else None

    def add(self) -> Feed:
        """Return the feed of a new client."""
        feed = Feed(self.painted, notice=self._notice)
        self.open.add(feed)
        return feed

    def remove(self, feed: Feed) -> None:
        """Forget a client that is gone."""
        self.open.discard(feed)

    def offer(self, message: FeedMessage) -> None:
        """Give every client the newest frame."""
        for feed in self.open:
            feed.offer(message)

    def tell(self, notice: str) -> None:
        """Give every client, now and later, a text message, if it differs from the last."""
        if notice == self._notice:
            return
        self._notice = notice
        for feed in self.open:
            feed.tell(notice)
