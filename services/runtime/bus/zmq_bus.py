"""The bus over ZeroMQ: no broker, one PUB socket per topic and one for batches of a fast topic, single-part frames.

On one host the loops send and receive the fast topics themselves (`trocar.services.runtime.bus.direct`); libzmq handles
all others. In a rig on several hosts, processes with the same address in the rig file are on one host, and share its
run directory.
"""

from __future__ import annotations

import select
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from typing import IO

import msgspec
import zmq

import trocar.protocol.bodies as bodies
from trocar.protocol import Frame, Reason, topic
from trocar.services.runtime.bus import bus, endpoints, keys
from trocar.services.runtime.bus.clocks import Clocks
from trocar.services.runtime.bus.direct import RECONNECT_S, ROUNDING_S, DirectReader, DirectSender
from trocar.services.runtime.bus.frame_batches import (
    SENDS_PER_S,
    BatchSender,
    batch_endpoint,
    count_readers,
    has_batches,
    is_readable,
    lengths_and_frames,
)
from trocar.services.runtime.config.rig import Transport
from trocar.services.runtime.errors import BusError
from trocar.services.runtime.realtime.scheduling import step_aside

#: Frames that a slow reader may fall behind before frames are lost and counted: ZeroMQ's default. The topics that it is
#: for have at most 60 frames a second, so it lasts for a quarter of a minute at least.
_HIGH_WATER_MARK = 1000
#: Batches that a publisher keeps for a process that is not run at all, of three seconds. A process that runs, but has
#: no time for its frames, keeps those of `bus.BACKLOG_S` itself.
_BATCHES_KEPT = 3 * SENDS_PER_S
#: Longest interval of reconnecting to a missing publisher; otherwise a thread of the reader's priority would try 500
#: times a second for a topic whose process the rig does not have.
_RECONNECT_MAX_MS = 50
#: Frames between two updates of the number of readers, since subscriptions of sampling readers accumulate.
_COUNT_READERS_EVERY = 16
_ROUNDING_NS = round(1e9 * ROUNDING_S)


class ZmqBus:
    """ZeroMQ sockets of one process. Create it after the real-time set-up, as its I/O thread inherits core and
    priority.

    Raises BusError if an endpoint is in use, or a topic has a publisher in the run directory.

    Args:
        transport: Settings of the rig file.
        publishes, reads: Topic names. Of state topics only the newest frame is read.
        reads_every: Topics of which every frame is read, regardless of the table, for recorders and sniffers. Fast ones
            come in batches, so that no publisher waits for such a reader (`trocar.services.runtime.bus.frame_batches`).
        samples: Topics of which a frame is read now and then, see `sample`.
    """

    def __init__(
        self,
        transport: Transport,
        publishes: Iterable[str] = (),
        reads: Iterable[str] = (),
        reads_every: Iterable[str] = (),
        samples: Iterable[str] = (),
    ) -> None:
        self._context = zmq.Context()
        self._context.linger = 0
        self._locks: list[IO[str]] = []
        self._paths: list[Path] = []  # of sockets bound by libzmq, which does not remove them
        self._direct_senders: dict[str, DirectSender] = {}
        self._direct_readers: dict[str, DirectReader] = {}
        self._senders: dict[str, zmq.Socket[bytes]] = {}
        self._receivers: dict[str, zmq.Socket[bytes]] = {}
        self._descriptors: dict[str, int] = {}
        self._subscribed: dict[str, int] = {}
        self._standing: set[str] = set()  # sampled topics with a permanent subscription
        self._batches: dict[str, BatchSender] = {}
        self._out: dict[str, bus.Outbox] = {}
        self._in: dict[str, bus.Inbox] = {}
        self.on_flood: Callable[[], None] = lambda: None
        incarnation = bus.new_incarnation()
        known = keys.load(transport.keys) if transport.keys else None
        self._authenticator = keys.ZapAuthenticator(self._context, known) if known else None
        publishes, reads, reads_every, samples = map(tuple, (publishes, reads, reads_every, samples))
        heard = {topic(name).publisher for name in (*reads, *reads_every, *samples)}
        self._name = topic(publishes[0]).publisher if publishes else ""
        try:
            self._clocks = Clocks(self._context, transport, self._authenticator, self._name, heard)
            for name in publishes:
                self._bind(transport, name, incarnation)
            for name in reads:
                self._read_newest(transport, name)
            for name in reads_every:
                self._connect(transport, name, every=True).setsockopt(zmq.SUBSCRIBE, b"")
            for name in samples:
                self._connect(transport, name, samples=True)
        except BaseException:
            self.close()
            raise

    def _bind(self, transport: Transport, name: str, incarnation: int) -> None:
        row = topic(name)
        self._locks.append(endpoints.claim(transport, name))
        if has_batches(row) and any(transport.shares_host(self._name, each) for each in row.readers):
            self._direct_senders[name] = _direct_sender(transport, name)
        if transport.kind == "tcp" or not has_batches(row):
            self._senders[name] = self._bound(transport, name, name, _HIGH_WATER_MARK)
            self._subscribed[name] = 0
        self._out[name] = bus.Outbox(row, incarnation)
        if has_batches(row):
            self._batches[name] = BatchSender(self._bound(transport, name, batch_endpoint(name), _BATCHES_KEPT))

    def _bound(self, transport: Transport, name: str, endpoint_name: str, most: int) -> zmq.Socket[bytes]:
        """Return a socket that sends topic `name` and keeps `most` messages for a slow reader."""
        host = None if transport.kind == "ipc" else transport.bind_host
        where = endpoints.endpoint(transport, endpoint_name, host)
        socket = self._context.socket(zmq.XPUB)  # XPUB reports subscriptions, for readiness without sleeping
        socket.setsockopt(zmq.XPUB_VERBOSER, 1)  # for every reader, not only for the first and the last
        socket.sndhwm = most
        if self._authenticator:
            self._authenticator.guard_publisher(socket)
        try:
            socket.bind(where)
        except zmq.ZMQError as error:
            raise BusError(f"topic {name}: cannot bind {where}: {error.strerror}") from None
        if transport.kind == "ipc":
            self._paths.append(Path(endpoints.ipc_path(transport, endpoint_name)))
        return socket

    def _read_newest(self, transport: Transport, name: str) -> None:
        row = topic(name)
        if has_batches(row) and transport.shares_host(self._name, row.publisher):
            self._direct_readers[name] = DirectReader(endpoints.ipc_path(transport, name))
            self._in[name] = bus.Inbox(row, on_flood=self._flooded)
        else:
            self._connect(transport, name).setsockopt(zmq.SUBSCRIBE, b"")

    def _connect(
        self, transport: Transport, name: str, *, every: bool = False, samples: bool = False
    ) -> zmq.Socket[bytes]:
        row = topic(name)
        box = bus.Inbox(row, every=every, on_flood=self._flooded)
        box.clock = self._clocks.offsets.get(row.publisher)
        socket = self._context.socket(zmq.SUB)
        if box.every:
            socket.rcvhwm = _HIGH_WATER_MARK if batch_endpoint(name) == name else round(bus.BACKLOG_S * SENDS_PER_S)
        else:
            socket.conflate = True  # keeps the newest; needs one topic and one part per socket
        socket.reconnect_ivl = round(1e3 * RECONNECT_S)
        if samples or box.every or not has_batches(box.row):  # over tcp the hand waits for a fast topic
            socket.reconnect_ivl_max = _RECONNECT_MAX_MS
        where = endpoints.endpoint(transport, batch_endpoint(name) if every else name)
        if self._authenticator:
            self._authenticator.guard_reader(socket, where)
        socket.connect(where)
        self._receivers[name] = socket
        self._descriptors[name] = int(socket.getsockopt(zmq.FD))
        self._in[name] = box
        return socket

    def publish(
        self, name: str, body: msgspec.Struct, *, origin_ns: int = 0, valid: bool = True, at_once: bool = False
    ) -> int:
        """Send `body` without waiting; a slow reader loses frames.

        A fast topic on one host is sent immediately. Frames of libzmq leave when the process sleeps, all of a tick
        together, as its thread has the priority of the process; ``at_once`` lets that thread run first.
        """
        box, batches = self._out[name], self._batches.get(name)
        data = box.seal(body, origin_ns, valid)
        direct, sender = self._direct_senders.get(name), self._senders.get(name)
        if direct is not None:
            direct.send(data)
        if sender is not None:
            sender.send(data, zmq.NOBLOCK)
            if at_once and direct is None:
                step_aside()
        if batches is not None:
            batches.add(data, time.monotonic_ns())
        if box.sent % _COUNT_READERS_EVERY == 0:
            self.has_reader(name)
        if self._authenticator:
            self._authenticator.answer()
        if batches is None:  # processes without fast topics do not flush
            self._clocks.exchange_times()
        return box.sent - 1

    def flush(self) -> None:
        """Send the batches that are due for observers, and update the clocks of other hosts."""
        self._clocks.exchange_times()
        if self._batches:
            now_ns = time.monotonic_ns()
            for batches in self._batches.values():
                batches.send_if_due(now_ns)

    def latest(self, name: str) -> Frame | None:
        """Return the newest unread frame of `name`, or None."""
        box, direct = self._in[name], self._direct_readers.get(name)
        if direct is not None:
            data = direct.newest()
            return None if data is None else box.accept(data)
        if not box.is_near:
            self._clocks.exchange_times()
        socket = self._receivers[name]
        if not is_readable(socket):
            return None
        try:
            return box.accept(socket.recv(zmq.NOBLOCK))
        except zmq.Again:
            return None

    def drain(self, name: str) -> list[Frame]:
        """Return the unread frames of `name`, oldest first, at most `bus.DRAIN_LIMIT`."""
        frames: list[Frame] = []
        n_taken = 0
        while n_taken < bus.DRAIN_LIMIT and (batch := self.batch(name)) is not None:
            frames += batch.frames()
            n_taken += len(batch.lengths) // 4
        return frames

    def batch(self, name: str) -> bus.Batch | None:
        """Return the next unread message of `name`, unchecked; a single frame is a batch of one."""
        socket, box = self._receivers[name], self._in[name]
        if not box.is_near:
            self._clocks.exchange_times()
        if not is_readable(socket):  # the usual case, at a third of the cost of an exception
            return None
        try:
            return bus.Batch(*lengths_and_frames(socket.recv_multipart(zmq.NOBLOCK)), box)
        except zmq.Again:
            return None

    def sample(self, names: Iterable[str], until_ns: int) -> dict[str, Frame]:
        """Subscribe, read the next frame of each of `names`, unsubscribe; missing frames are left out.

        If the host is too far away for that, the subscription is permanent and the newest frame is returned.
        """
        names, frames = tuple(names), dict[str, Frame]()
        for name in names:
            if name not in self._standing:
                self._forget(self._receivers[name])
                self._receivers[name].setsockopt(zmq.SUBSCRIBE, b"")
        for name in names:
            if frame := self.latest(name) or (self.latest(name) if self.wait(name, until_ns) else None):
                frames[name] = frame
            if self._in[name].is_far:
                self._standing.add(name)
            else:
                self._receivers[name].setsockopt(zmq.UNSUBSCRIBE, b"")
                self._standing.discard(name)
        return frames

    @staticmethod
    def _forget(socket: zmq.Socket[bytes]) -> None:
        """Discard frames that arrived after the last sample, which are old."""
        with suppress(zmq.Again):
            while True:
                socket.recv(zmq.NOBLOCK)

    def wait(self, name: str, until_ns: int) -> bool:
        """Sleep until `name` may have a frame or the clock reaches `until_ns`, finer than zmq_poll's milliseconds."""
        direct = self._direct_readers.get(name)
        if direct is not None:
            return direct.wait(until_ns)
        socket = self._receivers[name]
        descriptor = self._descriptors[name]
        while not is_readable(socket):
            remaining_ns = until_ns - time.monotonic_ns()
            if remaining_ns <= 0:
                return False
            if remaining_ns < _ROUNDING_NS:
                time.sleep(remaining_ns * 1e-9)
                continue
            # It is edge triggered: EVENTS was read just before, so any later message makes it readable.
            select.select((descriptor,), (), (), remaining_ns * 1e-9)
        return True

    def is_fresh(self, *names: str) -> bool:
        """Return whether the last frame of every topic may still be acted on."""
        now = time.monotonic_ns()
        return all(self._in[name].is_fresh(now) for name in names)

    def has_reader(self, name: str) -> bool:
        """Return whether `name` has a subscriber now."""
        if self._authenticator:
            self._authenticator.answer()
        readers, direct, sender = 0, self._direct_senders.get(name), self._senders.get(name)
        if direct is not None:
            direct.look()
            readers = direct.readers
        if sender is not None:
            self._subscribed[name] = count_readers(sender, self._subscribed[name])
            readers += self._subscribed[name]
        batches = self._batches.get(name)
        if batches is not None:
            batches.look()
            readers += batches.readers
        return readers > 0

    def is_near(self, name: str) -> bool:
        """Return whether the publisher of `name` uses this host's clock."""
        return self._in[name].is_near

    def gauges(self) -> dict[str, float]:
        """Return the number of peers refused without the rig's keys, and the offsets of other hosts' clocks."""
        doorkeeper = self._authenticator
        refused = doorkeeper.refused + doorkeeper.breaches() if doorkeeper else 0
        return {"refused_readers": float(refused), **self._clocks.gauges()}

    def reports(self) -> tuple[bodies.TopicReport, ...]:
        """Return the counts of all topics."""
        for name, direct in self._direct_readers.items():
            if direct.violations:
                self._in[name].refused[Reason.MALFORMED] += direct.violations
                direct.violations = 0
        return bus.summarise(self._out, self._in)

    def floods(self) -> dict[str, int]:
        """Return the number of frames beyond the rate of each flooded topic."""
        return bus.floods(self._in)

    def _flooded(self) -> None:
        self.on_flood()

    def close(self) -> None:
        """Close all sockets; only the last batches linger, for some milliseconds."""
        for batches in self._batches.values():
            batches.close()
        self._batches.clear()
        for sender in self._direct_senders.values():
            sender.close()
        for reader in self._direct_readers.values():
            reader.close()
        self._context.destroy(linger=0)
        for path in self._paths:  # while the locks are held, so that no other publisher has bound them
            path.unlink(missing_ok=True)
        self._paths.clear()
        for lock in self._locks:
            lock.close()
        self._locks.clear()


def _direct_sender(transport: Transport, name: str) -> DirectSender:
    path = endpoints.ipc_path(transport, name)
    try:
        return DirectSender(path)
    except OSError as error:
        raise BusError(f"topic {name}: cannot bind {path}: {error.strerror}") from None
