"""Messages of the supervisor over Unix sockets, with its page's process and with senders of commands."""

from __future__ import annotations

import socket
from typing import TypeVar

import msgspec

from trocar.services.runtime.bus.claim import Claim

#: More than the largest message, a rig file as JSON.
_MESSAGE_MAX = 1 << 18
#: The page's first message waits for it when it starts, so that only a supervisor that has ended sends none.
_WAIT_S = 10.0


class PageSetup(msgspec.Struct, frozen=True):
    """The first message to the page. `rig` is the rig as JSON, with defaults and overrides.

    `switches` tells whether the session can switch to another scenario; `fingerprint` is that of the certificate by
    which the page is encrypted, empty without one; `scene_overrides` are those of the command line, and `asked` is what
    the rig was started with: the name of its file, and all overrides.
    """

    rig: str
    scene: str
    token: str
    switches: bool = False
    fingerprint: str = ""
    scene_overrides: tuple[str, ...] = ()
    asked: tuple[str, tuple[str, ...]] = ("", ())


class Heartbeat(msgspec.Struct, frozen=True):
    """Sign of life of the page's process."""


_T = TypeVar("_T", bound=msgspec.Struct)


class Link:
    """One end of the socket pair; only `wait` blocks."""

    def __init__(self, end: socket.socket) -> None:
        self._end = end

    @classmethod
    def pair(cls) -> tuple[Link, Link]:
        """Return both ends of a pair that keeps message boundaries; each end detects the loss of the other."""
        one, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        for end in (one, other):
            end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 2 * _MESSAGE_MAX)
        return cls(one), cls(other)

    def fileno(self) -> int:
        """Return the descriptor."""
        return self._end.fileno()

    def send(self, message: msgspec.Struct) -> bool:
        """Send a message unless the other end is slow or gone; return whether it was sent."""
        try:
            self._end.send(msgspec.json.encode(message), socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL)
        except OSError:  # also if this end is closed
            return False
        return True

    def receive(self, kind: type[_T]) -> _T | None:
        """Return the next message, None without one. Raises ConnectionError if the other end is gone."""
        try:
            data = self._end.recv(_MESSAGE_MAX, socket.MSG_DONTWAIT)
        except BlockingIOError:
            return None
        if not data:
            raise ConnectionResetError("the other end is gone")
        return msgspec.json.decode(data, type=kind)

    def receive_claimed(self, kind: type[_T]) -> tuple[_T, Claim | None] | None:
        """Return the next message with the claim that came with it; else as `receive`."""
        try:
            data, claim, _ = Claim.receive(self._end, _MESSAGE_MAX)
        except BlockingIOError:
            return None
        try:
            if not data:
                raise ConnectionResetError("the other end is gone")
            return msgspec.json.decode(data, type=kind), claim
        except BaseException:
            if claim is not None:
                claim.close()
            raise

    def send_claimed(self, message: msgspec.Struct, claim: Claim) -> None:
        """Send a message that is only carried out if its receiver can take the claim. Raises OSError."""
        claim.send_with(self._end, msgspec.json.encode(message))

    def newest(self, kind: type[_T]) -> _T | None:
        """Return the last received message, None without one; raises as `receive` does."""
        newest = None
        while (message := self.receive(kind)) is not None:
            newest = message
        return newest

    def wait(self, kind: type[_T], timeout_s: float = _WAIT_S) -> _T | None:
        """Return the next message, None without one within `timeout_s`; raises as `receive` does."""
        self._end.settimeout(timeout_s)
        try:
            self._end.recv(1, socket.MSG_PEEK)
        except TimeoutError:
            return None
        finally:
            self._end.settimeout(None)
        return self.receive(kind)

    def close(self) -> None:
        """Close this end."""
        self._end.close()
