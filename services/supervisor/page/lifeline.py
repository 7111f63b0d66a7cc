"""A line between the supervisor and a helper that it has started: either notices when the other has ended."""

from __future__ import annotations

import socket

#: Signs taken at once, as many as come in twelve seconds; the rest is for later turns.
_MOST = 64


class Lifeline:
    """One end of the line. No word goes over it, only signs of life, and it never waits."""

    def __init__(self, end: socket.socket) -> None:
        self._end = end

    @classmethod
    def pair(cls) -> tuple[Lifeline, Lifeline]:
        """Return both ends."""
        one, other = socket.socketpair()
        return cls(one), cls(other)

    @classmethod
    def of(cls, descriptor: int) -> Lifeline:
        """Return the end that a helper was given."""
        return cls(socket.socket(fileno=descriptor))

    def fileno(self) -> int:
        """Return the descriptor."""
        return self._end.fileno()

    def beat(self) -> bool:
        """Give a sign of life, which one that does not listen loses; return whether the other end is there."""
        try:
            self._end.send(b"\0", socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL)
        except ConnectionError:
            return False
        except OSError:  # it does not listen now
            return True
        return True

    def heard(self) -> bool:
        """Return whether the other end has given a sign of life since the last call."""
        try:
            return bool(self._end.recv(_MOST, socket.MSG_DONTWAIT))
        except OSError:  # nothing, or it has ended with what was sent to it unread
            return False

    def close(self) -> None:
        """Close this end."""
        self._end.close()
