"""A CAN bus between two processes of this rig: an unnamed pair of sockets, which no other process can reach."""

from __future__ import annotations

import select
import socket
from collections import deque

import can

from trocar.services.gateway.can import can_frame
from trocar.services.gateway.can.canbus import DRAIN_LIMIT

#: Bytes read at once: a second of one handle's frames.
_READ = DRAIN_LIMIT * can_frame.SIZE


class LocalBus(can.BusABC):  # type: ignore[misc]  # python-can is not read by mypy
    """One end of the pair, used like any bus of python-can.

    All available frames are read at once and then returned singly, so that finding no more costs nothing.

    Args:
        end: End of a pair ``AF_UNIX``, ``SOCK_STREAM``, on which only whole frames are sent.
    """

    def __init__(self, end: socket.socket) -> None:
        self._end = end
        end.setblocking(False)
        self._heard: deque[can.Message] = deque()
        self._emptied = False
        self.channel_info = "to the emulated drives"
        super().__init__(channel="local")

    def fileno(self) -> int:
        """Return the descriptor, for polling."""
        return self._end.fileno()

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send without waiting; raise an error if the other end does not read."""
        flags = msg.is_extended_id * can_frame.EXTENDED | msg.is_remote_frame * can_frame.REMOTE
        try:
            self._end.send(can_frame.pack(msg.arbitration_id | flags, bytes(msg.data)))
        except OSError as error:
            raise can.CanOperationError(f"the emulated drive does not listen: {error.strerror}") from None

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if self._heard:
            return self._heard.popleft(), True
        if self._emptied and timeout == 0.0:
            self._emptied = False  # one report of "no more" without a system call
            return None, True
        if timeout is None or timeout > 0.0:
            select.select((self._end,), (), (), timeout)
        self._read()
        self._emptied = bool(self._heard)
        return (self._heard.popleft() if self._heard else None), True

    def _read(self) -> None:
        try:
            data = self._end.recv(_READ)
        except BlockingIOError:
            return
        except OSError as error:
            raise can.CanOperationError(f"the emulated drive is gone: {error.strerror}") from None
        if not data:
            raise can.CanOperationError("the emulated drive is gone")
        self._heard.extend(_message(identifier, frame) for identifier, frame in can_frame.unpack(data))

    def shutdown(self) -> None:
        """Close this end."""
        super().shutdown()
        self._end.close()


def _message(identifier: int, data: bytes) -> can.Message:
    return can.Message(
        arbitration_id=identifier & can_frame.ADDRESS,
        is_extended_id=bool(identifier & can_frame.EXTENDED),
        is_remote_frame=bool(identifier & can_frame.REMOTE),
        data=data,
    )
