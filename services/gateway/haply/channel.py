"""A WebSocket that never waits: the protocol of the package `websockets` on a socket of this process."""

from __future__ import annotations

import socket

from websockets.client import ClientProtocol
from websockets.frames import Opcode
from websockets.protocol import OPEN
from websockets.uri import parse_uri

from trocar.protocol.topics import TICK_S
from trocar.services.gateway.devices.clock import Clock

#: Bytes read in a tick, so that a flood cannot take the core; and the longest message: of ten devices, 20 kB.
_READ, _LONGEST = 1 << 17, 1 << 17
_DATA = (Opcode.TEXT, Opcode.BINARY, Opcode.CONT)


class Channel:
    """An open WebSocket; made by `open_channel`.

    Attributes:
        lost: str. Empty, or why it has ended.
    """

    def __init__(self, wire: socket.socket, address: str) -> None:
        self.lost = ""
        self._wire = wire
        self._protocol = ClientProtocol(parse_uri(address), max_size=_LONGEST)
        self._unsent = bytearray()
        self._part = bytearray()
        self._came: list[bytes] = []
        self._protocol.send_request(self._protocol.connect())
        self._flush()

    @property
    def is_open(self) -> bool:
        """Whether messages can be sent."""
        return self._protocol.state is OPEN and not self.lost

    def send(self, message: bytes) -> None:
        """Send a text message; one that does not fit into the kernel's buffer is sent on by the next calls."""
        if self.is_open:
            self._protocol.send_text(message)
            self._flush()

    def receive(self) -> list[bytes]:
        """Return the messages that have come."""
        self.pump()
        messages, self._came = self._came, []
        return messages

    def pump(self) -> None:
        """Take what has come; the first message may come with the end of the handshake."""
        if self.lost:
            return
        try:
            self._take_bytes(self._wire.recv(_READ))
        except BlockingIOError:
            pass
        except OSError as error:
            self.lost = error.strerror or type(error).__name__
        self._came += [message for event in self._protocol.events_received() if (message := self._complete(event))]
        self._flush()  # an answer to a ping
        if not self.lost and self._protocol.close_expected():
            self.lost = "it has closed the connection"
        if self._protocol.handshake_exc is not None:
            self.lost = f"it does not speak WebSocket: {self._protocol.handshake_exc}"

    def close(self) -> None:
        """Say goodbye, as far as the kernel takes it, and close the socket."""
        if self.is_open:
            self._protocol.send_close()
            self._flush()
        self.lost = self.lost or "closed"
        self._wire.close()

    def _take_bytes(self, data: bytes) -> None:
        if data:
            self._protocol.receive_data(data)
        else:
            self._protocol.receive_eof()
            self.lost = self.lost or "it has closed the connection"

    def _complete(self, event: object) -> bytes:
        """Return a message that is complete with this frame, else none."""
        if getattr(event, "opcode", None) not in _DATA:
            return b""
        self._part += event.data  # type: ignore[attr-defined]  # a frame
        if not event.fin:  # type: ignore[attr-defined]
            return b""
        message, self._part = bytes(self._part), bytearray()
        return message

    def _flush(self) -> None:
        for data in self._protocol.data_to_send():
            self._unsent += data
        while self._unsent and not self.lost:
            try:
                del self._unsent[: self._wire.send(self._unsent)]
            except BlockingIOError:
                return
            except OSError as error:
                self.lost = error.strerror or type(error).__name__


def open_channel(host: str, port: int, timeout_s: float, clock: Clock) -> Channel:
    """Return a channel after its handshake.

    Raises OSError with the reason, if nobody answers, or not as a WebSocket.
    """
    wire = socket.create_connection((host, port), timeout_s)
    wire.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    wire.setblocking(False)
    channel = Channel(wire, f"ws://{host}:{port}/")
    until_ns = clock.monotonic_ns() + round(1e9 * timeout_s)
    while not channel.is_open:
        channel.pump()
        if channel.lost or clock.monotonic_ns() > until_ns:
            why = channel.lost or f"no WebSocket within {timeout_s:g} s"
            channel.close()
            raise OSError(why)
        clock.sleep(TICK_S)
    return channel
