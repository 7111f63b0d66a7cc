"""Feeds of the view's clients: always the newest frame, never a queue."""

from __future__ import annotations

import asyncio
import time
from dataclasses import dataclass, field

from trocar.services.runtime.process.health import LatencyPath

#: Most frames sent to a client and not acknowledged as painted. A tunnel with a round trip of 100 ms still gets 60
#: pictures a second; a suspended client (a hidden tab) is sent nothing and resumes with the newest.
IN_FLIGHT = 6
#: The last part of a wait between pictures is slept, as asyncio rounds its waits up to milliseconds.
MARGIN_NS = 1_500_000


@dataclass(slots=True)
class FeedMessage:
    """A frame, and the hello for decoding it."""

    epoch: int
    hello: str
    sequence: int
    origin_ns: int
    data: bytes


@dataclass(slots=True, eq=False)
class Feed:
    """One client: a slot for the newest message, and acknowledgements."""

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
        """Put `message` in the slot, replacing an unsent one; messages beyond the wanted rate are skipped."""
        if self.wanted_hz is not None and message.epoch == self.epoch:
            now_ns, period_ns = time.monotonic_ns(), round(1e9 / self.wanted_hz)
            if now_ns < self.due_ns - period_ns // 8:  # slightly early is on time, as pictures have their own grid
                return
            self.due_ns = (now_ns if now_ns - self.due_ns > period_ns else self.due_ns) + period_ns
        if self.newest is not None:
            self.superseded += 1
        self.newest = message
        self.wake.set()

    def want(self, hz: float | None) -> None:
        """Set the client's rate of pictures; None for all."""
        self.wanted_hz = hz
        self.due_ns = 0

    def tell(self, notice: str) -> None:
        """Set the text message to send; only the newest is kept."""
        self.notice = notice
        self.wake.set()

    def reset(self) -> None:
        """Reset for a new client."""
        self.epoch = -1
        self.origins.clear()
        self.wake.set()

    async def next(self) -> list[str | bytes]:
        """Wait for messages that may be sent, and return them: notice, hello, frame."""
        while True:
            parts = self._take_parts()
            if parts:
                return parts
            self.wake.clear()
            await self.wake.wait()

    def acknowledge(self, sequence: int) -> None:
        """Process the acknowledgement of painting `sequence`: count the latency and allow more frames."""
        origin_ns = self.origins.get(sequence)
        if origin_ns is None:
            return
        for sent in [s for s in self.origins if s <= sequence]:
            del self.origins[sent]
        self.painted.answered += 1
        if origin_ns:
            self.painted.latency.record(time.monotonic_ns() - origin_ns)
        self.wake.set()

    def _take_parts(self) -> list[str | bytes]:
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
        """Return the rate wanted by the fastest client; None for all, or without clients."""
        wanted = [feed.wanted_hz for feed in self.open]
        known = [hz for hz in wanted if hz is not None]
        return max(known) if known and len(known) == len(wanted) else None

    def add(self) -> Feed:
        """Return the feed of a new client."""
        feed = Feed(self.painted, notice=self._notice)
        self.open.add(feed)
        return feed

    def remove(self, feed: Feed) -> None:
        """Remove a disconnected client."""
        self.open.discard(feed)

    def offer(self, message: FeedMessage) -> None:
        """Offer the newest frame to every client."""
        for feed in self.open:
            feed.offer(message)

    def tell(self, notice: str) -> None:
        """Send a text message to every present and later client, if it differs from the last."""
        if notice == self._notice:
            return
        self._notice = notice
        for feed in self.open:
            feed.tell(notice)
