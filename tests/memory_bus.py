"""A bus in one process, without sockets. Frames are encoded and checked as on the real one."""

from __future__ import annotations

import time
from collections import defaultdict, deque
from collections.abc import Callable, Iterable

import msgspec

import trocar.protocol.bodies as bodies
from trocar.protocol import Frame, topic
from trocar.services.runtime.bus import bus
from trocar.services.runtime.bus.frame_batches import join


class MemoryHub:
    """Where the memory buses of a test meet."""

    def __init__(self) -> None:
        self.queues: defaultdict[str, list[deque[bytes]]] = defaultdict(list)

    def send(self, name: str, data: bytes) -> None:
        """Hand raw bytes to every reader of `name`: what a strange peer would do."""
        for queue in self.queues[name]:
            queue.append(data)


class MemoryBus:
    """Same behaviour as `trocar.services.runtime.bus.zmq_bus.ZmqBus`, without sockets and without waiting."""

    def __init__(
        self,
        hub: MemoryHub,
        publishes: Iterable[str] = (),
        reads: Iterable[str] = (),
        reads_every: Iterable[str] = (),
        samples: Iterable[str] = (),
    ) -> None:
        self._hub = hub
        incarnation = bus.new_incarnation()
        self._out = {name: bus.Outbox(topic(name), incarnation) for name in publishes}
        self.on_flood: Callable[[], None] = lambda: None
        wanted = {**dict.fromkeys((*reads, *samples), False), **dict.fromkeys(reads_every, True)}
        self._in = {
            name: bus.Inbox(topic(name), every=every, on_flood=lambda: self.on_flood())
            for name, every in wanted.items()
        }
        self._queues: dict[str, deque[bytes]] = {}
        for name, box in self._in.items():
            self._queues[name] = deque(maxlen=None if box.every else 1)
            hub.queues[name].append(self._queues[name])

    def publish(
        self, name: str, body: msgspec.Struct, *, origin_ns: int = 0, valid: bool = True, at_once: bool = False
    ) -> int:
        """Hand `body` to every reader at once."""
        box = self._out[name]
        self._hub.send(name, box.seal(body, origin_ns, valid))
        return box.sent - 1

    def flush(self) -> None:
        """Everything has been handed on."""

    def latest(self, name: str) -> Frame | None:
        """Return the newest unread frame of `name`, or None."""
        queue = self._queues[name]
        return self._in[name].accept(queue.pop()) if queue else None

    def drain(self, name: str) -> list[Frame]:
        """Return the unread frames of `name`, oldest first."""
        queue, box = self._queues[name], self._in[name]
        frames = [box.accept(queue.popleft()) for _ in range(min(len(queue), bus.DRAIN_LIMIT))]
        return [frame for frame in frames if frame is not None]

    def batch(self, name: str) -> bus.Batch | None:
        """Return the next unread frame of `name`, as a batch of one."""
        queue = self._queues[name]
        return bus.Batch(*join([queue.popleft()]), self._in[name]) if queue else None

    def sample(self, names: Iterable[str], until_ns: int) -> dict[str, Frame]:
        """Return the newest unread frames of `names`."""
        frames = {name: self.latest(name) for name in names}
        return {name: frame for name, frame in frames.items() if frame is not None}

    def wait(self, name: str, until_ns: int) -> bool:
        """Return at once whether `name` has a frame: nothing else runs while this process waits."""
        return bool(self._queues[name])

    def is_fresh(self, *names: str) -> bool:
        """Return whether the last frame of every topic may still be acted on."""
        now = time.monotonic_ns()
        return all(self._in[name].is_fresh(now) for name in names)

    def is_near(self, name: str) -> bool:
        """Return True: nobody is on another host."""
        return True

    def gauges(self) -> dict[str, float]:
        """Return nothing: there are neither keys nor other hosts."""
        return {}

    def has_reader(self, name: str) -> bool:
        """Return whether a bus of the hub reads `name`."""
        return bool(self._hub.queues[name])

    def reports(self) -> tuple[bodies.TopicReport, ...]:
        """Return the counts of all topics."""
        return bus.summarise(self._out, self._in)

    def floods(self) -> dict[str, int]:
        """Return the frames beyond the rate of each topic that was flooded."""
        return bus.floods(self._in)

    def close(self) -> None:
        """Stop reading."""
        for name, queue in self._queues.items():
            self._hub.queues[name].remove(queue)
        self._queues.clear()
