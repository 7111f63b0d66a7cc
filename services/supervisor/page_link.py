"""Messages of the supervisor over Unix sockets: to its page's process, and with whoever commands it."""

from __future__ import annotations

import socket
from typing import TypeVar

import msgspec

import protocol.bodies as bodies
from services.supervisor.shown_recording import ReplayStatus
from services.supervisor.supervisor import Event, Supervisor

#: More than the largest status: two hundred events of a few hundred characters.
_MESSAGE_MAX = 1 << 18
_WAIT_S = 10.0


class PageSetup(msgspec.Struct, frozen=True):
    """The first message: what the page is to be. `rig` is the rig as JSON, defaults and overrides in it.

    `switches` tells whether who runs the rig begins another scenario when it is asked to.
    """

    rig: str
    scene: str
    token: str
    switches: bool = False


class RigStatus(msgspec.Struct, frozen=True):
    """The rig as the supervisor judges it. Times are seconds of the monotonic clock; `broken` are keys of breaches.

    `path_limits_us` are what the paths are judged against just now: no less than what the rig file says. `replay` is
    the recording whose pictures are shown, None in a rig that works.
    """

    said_s: float
    started_s: float
    state: bodies.SupervisorState
    broken: tuple[str, ...]
    path_limits_us: dict[str, float]
    events: tuple[Event, ...]
    replay: ReplayStatus | None = None
    incarnation: int = 0

    @classmethod
    def of(cls, supervisor: Supervisor, now_s: float) -> RigStatus:
        """Return the status now."""
        broken = tuple(breach.key for breach in supervisor.breaches)
        events = tuple(supervisor.events)
        limits_us = supervisor.path_limits_us()
        replay = supervisor.shown.status() if supervisor.shown is not None else None
        body, started_s = supervisor.body(), supervisor.started_s
        return cls(now_s, started_s, body, broken, limits_us, events, replay, supervisor.incarnation)


class Heartbeat(msgspec.Struct, frozen=True):
    """What the page's process says while it lives; `fault` is what is wrong with what it has started."""

    fault: str = ""


_T = TypeVar("_T", bound=msgspec.Struct)


class Link:
    """One end of the socket pair. Nothing in it waits but `wait`."""

    def __init__(self, end: socket.socket) -> None:
        self._end = end

    @classmethod
    def pair(cls) -> tuple[Link, Link]:
        """Return both ends; messages keep their boundaries, and an end that is gone is seen at the other."""
        one, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        for end in (one, other):
            end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 2 * _MESSAGE_MAX)
        return cls(one), cls(other)

    def fileno(self) -> int:
        """Return the descriptor."""
        return self._end.fileno()

    def send(self, message: msgspec.Struct) -> bool:
        """Send a message unless the other end is slow or gone; return whether it was."""
        try:
            self._end.send(msgspec.json.encode(message), socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL)
        except OSError:  # also of an end that is closed here
            return False
        return True

    def receive(self, kind: type[_T]) -> _T | None:
        """Return the next message, None where there is none. Raises ConnectionError if the other end is gone."""
        try:
            data = self._end.recv(_MESSAGE_MAX, socket.MSG_DONTWAIT)
        except BlockingIOError:
            return None
        if not data:
            raise ConnectionResetError("the other end is gone")
        return msgspec.json.decode(data, type=kind)

    def newest(self, kind: type[_T]) -> _T | None:
        """Return the last of the messages that have come, None where none has; raises as `receive` does."""
        newest = None
        while (message := self.receive(kind)) is not None:
            newest = message
        return newest

    def wait(self, kind: type[_T], timeout_s: float = _WAIT_S) -> _T | None:
        """Return the next message, None where none came within `timeout_s`; raises as `receive` does."""
        self._end.settimeout(timeout_s)
        try:
            self._end.recv(1, socket.MSG_PEEK)
        except TimeoutError:
            return None
        finally:
            self._end.settimeout(None)
        return self.receive(kind)

    def close(self) -> None:
        """Let go of this end."""
        self._end.close()
