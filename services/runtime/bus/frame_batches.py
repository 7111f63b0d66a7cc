"""Batches of all frames of a fast topic for observers, on a socket of their own.

A process that acts on a topic reads the topic's own socket, and each such reader costs the publisher some microseconds
a frame. Observers of every frame that are not urgent (a recorder, `trocar diagnose sniff`) subscribe here: a frame is
then one entry in a list, which is sent as one message at most `SENDS_PER_S` times a second, between two ticks. Without
a subscriber nothing is sent, and only the first frames are kept, since subscribers are known only at the first check,
and a recording without its first frames cannot be replayed.
"""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from itertools import accumulate, pairwise

import zmq

from trocar.protocol import Topic, topic

#: A batch costs the publisher 90 us, so all of a second cost 0.5 % of its time; observers show at most 60 pictures a
#: second.
SENDS_PER_S = 60
#: Most frames of a batch; readers count further ones as lost.
_LONGEST = 1000
#: Frames kept for the first reader, whose socket tries to connect every 50 ms.
_FIRST = 64
_GAP_NS = round(1e9 / SENDS_PER_S)
#: Age of a batch at which it is sent with the next frame, if the publisher does not call `send_if_due`: one that calls
#: it each tick is never as late, however the two periods fall.
_LATE_NS = 2 * _GAP_NS
#: How long a process waits for its last batches to be sent at its end.
_LINGER_MS = 20

#: As a plain number: an operation of an enumeration costs a microsecond.
_POLLIN = int(zmq.POLLIN)

Socket = zmq.Socket[bytes]


def has_batches(row: Topic) -> bool:
    """Return whether a topic is fast enough for batches."""
    return row.rate_hz > SENDS_PER_S


def batch_endpoint(name: str) -> str:
    """Return the name of the endpoint of the batches of topic `name`."""
    return f"{name}.whole" if has_batches(topic(name)) else name


def join(frames: Sequence[bytes]) -> tuple[bytes, bytes]:
    """Return the two parts of a batch: the lengths of its frames as 32-bit integers, and the frames one after another.

    Sending 17 frames of physics takes 34 us in this form, and 55 us as a part each.
    """
    return array("I", map(len, frames)).tobytes(), b"".join(frames)


def split(lengths: bytes, data: bytes) -> list[bytes]:
    """Return the frames of a batch."""
    return [data[begin:end] for begin, end in pairwise(accumulate(array("I", lengths), initial=0))]


def lengths_and_frames(parts: list[bytes]) -> tuple[bytes, bytes]:
    """Return the two parts of a batch; another message becomes a batch of it, which is then refused."""
    if len(parts) == 2 and len(parts[0]) % 4 == 0 and 0 < len(parts[0]) <= 4 * _LONGEST:
        lengths, data = parts
        if sum(array("I", lengths)) == len(data):
            return lengths, data
    return join(parts)


def is_readable(socket: Socket) -> bool:
    """Return whether `socket` has a message; this costs a third of an exception."""
    return bool(int(socket.getsockopt(zmq.EVENTS)) & _POLLIN)


def count_readers(socket: Socket, before: int) -> int:
    """Return the present number of subscribers of the XPUB `socket`, which was `before` at the last call."""
    while is_readable(socket):
        before += 1 if socket.recv(zmq.NOBLOCK)[:1] == b"\x01" else -1
    return before


class BatchSender:
    """Sends the frames of one topic to its observers.

    Attributes:
        readers: Number of subscribers at the last `look`.
    """

    def __init__(self, socket: Socket) -> None:
        self._socket = socket
        self._frames: list[bytes] = []
        self._due_ns = 0
        self._first_left = _FIRST
        self.readers = 0

    def look(self) -> None:
        """Update the number of subscribers; without any, discard the frames."""
        self.readers = count_readers(self._socket, self.readers)
        if not (self.readers or self._first_left):
            self._frames.clear()

    def add(self, data: bytes, now_ns: int) -> None:
        """Add a frame to the next batch, and send that if it is late."""
        if self._first_left:
            self._first_left -= 1
        elif not self.readers:
            self._frames.clear()
            return
        if len(self._frames) < _LONGEST:
            self._frames.append(data)
        self.send_if_due(now_ns - _LATE_NS)

    def send_if_due(self, now_ns: int) -> None:
        """Send the batch if the last one is long enough ago; call this while no other process waits."""
        if self._frames and self.readers and now_ns >= self._due_ns:
            self._due_ns = now_ns + _GAP_NS
            self._send()

    def close(self) -> None:
        """Send the last frames, which contain the removal of forces, and close the socket."""
        if self._frames and self.readers:
            self._send()
        self._socket.close(linger=_LINGER_MS)

    def _send(self) -> None:
        self._socket.send_multipart(join(self._frames), zmq.NOBLOCK)
        self._frames.clear()
