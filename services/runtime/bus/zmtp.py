"""ZeroMQ's wire protocol for a publisher or a subscriber without keys: ZMTP 3.0, mechanism NULL.

See https://rfc.zeromq.org/spec/23/. Both ends send a greeting of 64 bytes and a command ``READY``; then a subscriber
sends messages that begin with 1 (subscribe) or 0 (cancel), a publisher its frames.
"""

from __future__ import annotations

_LONG, _COMMAND = 2, 4  # flags of a part by RFC 23; multi-part messages are not used
_NULL = b"NULL".ljust(20, b"\0")
_READY = b"\x05READY"
GREETING = b"\xff\0\0\0\0\0\0\0\x01\x7f" + b"\x03\0" + _NULL + bytes(32)
SUBSCRIBE = b"\0\x01\x01"  # to everything


class ProtocolError(Exception):
    """A received message is not ZMTP 3, or too long."""


def ready(kind: bytes) -> bytes:
    """Return the command that ends the handshake of a socket of `kind`, ``PUB`` or ``SUB``."""
    body = _READY + b"\x0bSocket-Type" + len(kind).to_bytes(4, "big") + kind
    return bytes((_COMMAND, len(body))) + body


def framed(data: bytes) -> bytes:
    """Return `data` as a message of one part."""
    if len(data) < 256:
        return bytes((0, len(data))) + data
    return b"\x02" + len(data).to_bytes(8, "big") + data


def check_greeting(data: memoryview) -> None:
    """Check the first 64 bytes of a peer. Raises ProtocolError if they are not ZMTP 3 without keys."""
    if data[0] != 0xFF or data[9] != 0x7F or data[10] < 3 or data[12:32] != _NULL:
        raise ProtocolError("a peer that does not speak ZMTP 3, or wants keys")


class Incoming:
    """Splits a peer's bytes into messages. Write bytes into `room`, then call `messages`.

    Attributes:
        is_ready: Whether the peer has ended its handshake, before which libzmq accepts no message.

    Args:
        n_bytes: Initial size of the buffer, which grows for longer messages.
        longest: Largest length of a message.
    """

    def __init__(self, n_bytes: int, longest: int) -> None:
        self._buffer = bytearray(max(n_bytes, 2 * len(GREETING)))
        self._longest = longest
        self._view = memoryview(self._buffer)
        self._end = 0
        self._greeted = False
        self.is_ready = False

    def begin_peer(self) -> None:
        """Reset for another peer."""
        self._end = 0
        self._greeted = self.is_ready = False

    @property
    def room(self) -> memoryview:
        """The free part of the buffer, never empty."""
        return self._view[self._end :]

    def messages(self, n_read: int) -> list[bytes]:
        """Return the messages that are complete after `n_read` bytes were written into `room`.

        Raises ProtocolError if they are not ZMTP, or a message is too long; the object is unusable afterwards.
        """
        found: list[bytes] = []
        self._end += n_read
        start = 0
        if not self._greeted:
            if self._end < len(GREETING):
                return found
            check_greeting(self._view)
            self._greeted = True
            start = len(GREETING)
        while (part := self._part(start)) is not None:
            begin, end = part
            if not self._view[start] & _COMMAND:
                found.append(bytes(self._view[begin:end]))
            elif self._view[begin : begin + 6] == _READY:
                self.is_ready = True
            start = end
            if start == self._end:  # nearly always, as a peer sends a message at a time
                break
        self._keep(start)
        return found

    def _part(self, start: int) -> tuple[int, int] | None:
        """Return begin and end of the body whose header is at `start`; None if it is incomplete."""
        view, there = self._view, self._end - start
        if there < 2:
            return None
        flags = view[start]
        if flags & ~(_LONG | _COMMAND):
            raise ProtocolError("frames here are single messages")
        begin = start + (9 if flags & _LONG else 2)
        if begin > self._end:
            return None
        length = int.from_bytes(view[start + 1 : begin], "big")
        if length > self._longest:
            raise ProtocolError(f"a message of {length} bytes, at most {self._longest}")
        end = begin + length
        if end > self._end:
            self._hold(end - start)
            return None
        return begin, end

    def _keep(self, start: int) -> None:
        """Move an incomplete message to the beginning."""
        left = self._end - start
        if start and left:
            self._buffer[:left] = self._buffer[start : self._end]
        self._end = left

    def _hold(self, n_bytes: int) -> None:
        """Enlarge the buffer for a part of `n_bytes`."""
        if n_bytes >= len(self._buffer):
            grown = bytearray(n_bytes + len(self._buffer))
            grown[: self._end] = self._view[: self._end]
            self._buffer, self._view = grown, memoryview(grown)
