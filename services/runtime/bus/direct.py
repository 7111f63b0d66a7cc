"""Publisher and subscriber of the fast topics on one host, without threads: the loops send and receive themselves.

libzmq sends and receives in a thread of its own, so one frame from loop to loop wakes three threads: the sender's, the
reader's, and the reader itself. These ends use the same protocol (`trocar.services.runtime.bus.zmtp`) on the same
sockets, so that any ZeroMQ program can connect to them, but write when the loop sends and read when the loop reads:
only the waiting thread is woken, or none.
"""

from __future__ import annotations

import os
import select
import socket
import time
from contextlib import suppress
from pathlib import Path

from trocar.protocol.frame import MAX_FRAME_BYTES
from trocar.services.runtime.bus import zmtp

#: Most connections at one socket; a rig has at most half a dozen.
MAX_PEERS = 64
#: A subscription of our own has one byte, one of another program a prefix. All peers together hold at most 128 kB of
#: them.
_LONGEST_SUBSCRIPTION = 1024
#: More than the system's buffer of a connection, so that one read empties it.
_READ_BYTES = 1 << 18
#: Interval of connecting to a missing publisher: twice in the time after which a state topic is stale, so that a
#: restart costs the hand nothing more. A try takes some microseconds.
RECONNECT_S = 2e-3
#: The last part of a wait is slept, as select() may return this much early.
ROUNDING_S = 30e-6
_GONE = (ConnectionError, zmtp.ProtocolError)


class _Peer:
    """A connection in the publisher."""

    def __init__(self, connection: socket.socket) -> None:
        connection.setblocking(False)
        self.connection = connection
        self.subscriptions = 0
        self._incoming = zmtp.Incoming(0, _LONGEST_SUBSCRIPTION)
        self._rest = zmtp.GREETING + zmtp.ready(b"PUB")

    def hear(self) -> None:
        """Process the peer's subscriptions."""
        with suppress(BlockingIOError):
            n_read = self.connection.recv_into(self._incoming.room)
            if n_read == 0:
                raise ConnectionResetError
            for message in self._incoming.messages(n_read):
                if message[:1] == b"\x01":
                    self.subscriptions += 1
                elif message[:1] == b"\x00":
                    self.subscriptions = max(0, self.subscriptions - 1)
        self._send_rest()

    def send(self, message: bytes) -> None:
        """Send `message`, or drop it if the peer has not read earlier data."""
        if self._rest:
            self._send_rest()
            if self._rest:
                return
        try:  # cheaper than `suppress`
            n_sent = self.connection.send(message)
        except BlockingIOError:
            return
        if n_sent < len(message):
            self._rest = message[n_sent:]

    def _send_rest(self) -> None:
        if self._rest:
            with suppress(BlockingIOError):
                self._rest = self._rest[self.connection.send(self._rest) :]


class DirectSender:
    """Publishes at a path each frame to all subscribers that can receive it; never waits.

    Raises OSError if the path cannot be bound.

    Attributes:
        path: Path of the socket.
        sends: Number of frames sent, counted for each reader.

    Args:
        path: Path of the socket, which is replaced, so the caller must hold the lock of the endpoint.
    """

    def __init__(self, path: str) -> None:
        Path(path).unlink(missing_ok=True)
        self.path = path
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._listener.setblocking(False)
        self._listener.bind(path)
        self._listener.listen(MAX_PEERS)
        self._inode = os.stat(path).st_ino
        self._poll = select.epoll()
        self._poll.register(self._listener, select.EPOLLIN)
        self._peers: dict[int, _Peer] = {}
        self._subscribed: list[_Peer] = []
        self.sends = 0

    @property
    def readers(self) -> int:
        """Number of subscribers."""
        return len(self._subscribed)

    def look(self) -> None:
        """Process new and closed connections and subscriptions."""
        events = self._poll.poll(0)
        if not events:
            return
        for descriptor, _event in events:
            peer = self._peers.get(descriptor)
            if peer is None:
                self._accept()
                continue
            try:
                peer.hear()
            except _GONE:
                self._drop(peer)
        self._subscribed = [peer for peer in self._peers.values() if peer.subscriptions]

    def send(self, data: bytes) -> None:
        """Send a frame, also to those who have just subscribed for this one; subscribers with a full buffer lose it."""
        self.look()
        if not self._subscribed:
            return
        self.sends += len(self._subscribed)
        message = zmtp.framed(data)
        for peer in self._subscribed:
            try:
                peer.send(message)
            except _GONE:
                self._drop(peer)
                self._subscribed = [each for each in self._subscribed if each is not peer]

    def close(self) -> None:
        """Close every connection and remove the socket, unless another process has replaced it."""
        for peer in list(self._peers.values()):
            self._drop(peer)
        self._poll.close()
        self._listener.close()
        with suppress(FileNotFoundError):
            if os.stat(self.path).st_ino == self._inode:
                os.unlink(self.path)

    def _accept(self) -> None:
        with suppress(BlockingIOError, ConnectionError):
            connection = self._listener.accept()[0]
            if len(self._peers) >= MAX_PEERS:
                connection.close()
                return
            peer = _Peer(connection)
            self._peers[connection.fileno()] = peer
            self._poll.register(connection, select.EPOLLIN)
            try:
                peer.hear()
            except _GONE:
                self._drop(peer)

    def _drop(self, peer: _Peer) -> None:
        descriptor = peer.connection.fileno()
        self._poll.unregister(descriptor)
        del self._peers[descriptor]
        peer.connection.close()


class DirectReader:
    """Subscribes at a path and keeps the newest frame; reconnects after a loss of the publisher.

    Attributes:
        path: Path of the socket.
        violations: Number of messages that were not ZMTP, or too long for a frame.
    """

    def __init__(self, path: str) -> None:
        self.path = path
        self._connection: socket.socket | None = None
        self._incoming = zmtp.Incoming(_READ_BYTES, MAX_FRAME_BYTES)
        self._frame: bytes | None = None
        self._subscribed = False
        self._retry_s = 0.0
        self.violations = 0
        self._connect()

    def newest(self) -> bytes | None:
        """Return the newest frame if it is new, or None. Never waits."""
        if self._frame is None:
            self._read()
        frame, self._frame = self._frame, None
        return frame

    def wait(self, until_ns: int) -> bool:
        """Sleep until there is a frame (True) or the monotonic clock reaches `until_ns` (False).

        It sleeps before it reads: available data wakes it at once, and mostly there is none.
        """
        while self._frame is None:
            remaining_s = (until_ns - time.monotonic_ns()) * 1e-9
            if remaining_s >= ROUNDING_S and self._connection is not None:
                select.select((self._connection,), (), (), remaining_s)
            elif remaining_s > 0.0:
                time.sleep(min(remaining_s, RECONNECT_S))
            self._read()
            if remaining_s <= 0.0:
                return self._frame is not None
        return True

    def close(self) -> None:
        """Close the connection."""
        if self._connection is not None:
            self._connection.close()
            self._connection = None

    def _connect(self) -> None:
        now_s = time.monotonic()
        if now_s < self._retry_s:
            return
        self._retry_s = now_s + RECONNECT_S
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        connection.setblocking(False)
        try:
            connection.connect(self.path)
            connection.send(zmtp.GREETING + zmtp.ready(b"SUB"))
        except OSError:  # no publisher, or none that accepts now
            connection.close()
            return
        self._incoming.begin_peer()
        self._subscribed = False
        self._connection = connection

    def _read(self) -> None:
        """Read the received data."""
        if self._connection is None:
            self._connect()
            return
        try:
            n_read = self._connection.recv_into(self._incoming.room)
            if n_read == 0:
                raise ConnectionResetError
            messages = self._incoming.messages(n_read)
            if self._incoming.is_ready and not self._subscribed:
                self._connection.send(zmtp.SUBSCRIBE)
                self._subscribed = True
        except BlockingIOError:
            return
        except _GONE as fault:
            self.violations += isinstance(fault, zmtp.ProtocolError)
            self.close()
            return
        if messages:
            self._frame = messages[-1]
