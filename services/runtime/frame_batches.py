"""Every frame of a fast topic for observers: in batches, from a socket of their own.

A process that acts on a topic reads it from the topic's socket, and each such reader costs the publisher some
microseconds a frame. An observer that wants every frame but waits for none (a recorder, `trocar sniff`) subscribes
here: a frame is then one entry in a list, and at most `SENDS_PER_S` times a second the list is sent as one message,
between two ticks. Without a subscriber nothing is sent, and nothing but the first frames is kept: who has subscribed
is known at the first look only, and a recording without its first frames cannot be run again.
"""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from itertools import accumulate, pairwise

import zmq

from protocol import Topic, topic

SENDS_PER_S = 60
#: Frames kept for the next batch, whatever a publisher does; readers count those beyond as lost.
_LONGEST = 1000
#: Frames that wait for the first reader: its socket asks for a publisher that was not there every 50 ms.
_FIRST = 64
_GAP_NS = 1_000_000_000 // SENDS_PER_S
#: A publisher that does not say when it has time sends a batch that is so late with the next frame.
_LATE_NS = 2 * _GAP_NS
#: How long a process that ends in good order waits for its last batches to leave.
_LINGER_MS = 20

Socket = zmq.Socket[bytes]


def has_batches(row: Topic) -> bool:
    """Return whether a topic is so fast that observers get its frames in batches."""
    return row.rate_hz > SENDS_PER_S


def batch_endpoint(name: str) -> str:
    """Return the name of the endpoint from which every frame of topic `name` is read."""
    return f"{name}.whole" if has_batches(topic(name)) else name


def join(frames: Sequence[bytes]) -> tuple[bytes, bytes]:
    """Return the two parts of a batch: the lengths of its frames as 32-bit integers, and the frames one after another.

    Seventeen frames of physics take 34 us to send so, 55 as a part each.
    """
    return array("I", map(len, frames)).tobytes(), b"".join(frames)


def split(lengths: bytes, data: bytes) -> list[bytes]:
    """Return the frames of a batch."""
    return [data[begin:end] for begin, end in pairwise(accumulate(array("I", lengths), initial=0))]


def lengths_and_frames(parts: list[bytes]) -> tuple[bytes, bytes]:
    """Return the two parts of a batch as `join` makes them; what is none is a batch of what came, to be refused."""
    if len(parts) == 2 and len(parts[0]) % 4 == 0 and 0 < len(parts[0]) <= 4 * _LONGEST:
        lengths, data = parts
        if sum(array("I", lengths)) == len(data):
            return lengths, data
    return join(parts)


def is_readable(socket: Socket) -> bool:
    """Return whether something has arrived at `socket`: a third of what an exception costs."""
    return bool(int(socket.getsockopt(zmq.EVENTS)) & zmq.POLLIN)


def count_readers(socket: Socket, before: int) -> int:
    """Return how many have subscribed to the XPUB `socket` and not gone since, `before` of whom were known."""
    while is_readable(socket):
        before += 1 if socket.recv(zmq.NOBLOCK)[:1] == b"\x01" else -1
    return before


class BatchSender:
    """The frames of one topic for its observers.

    Attributes:
        readers: How many had subscribed at the last look.
    """

    def __init__(self, socket: Socket) -> None:
        self._socket = socket
        self._frames: list[bytes] = []
        self._due_ns = 0
        self._first_left = _FIRST
        self.readers = 0

    def look(self) -> None:
        """Find out who has come and gone; with the last reader goes what was kept."""
        self.readers = count_readers(self._socket, self.readers)
        if not (self.readers or self._first_left):
            self._frames.clear()

    def add(self, data: bytes, now_ns: int) -> None:
        """Keep a frame for the next batch; send it only where nobody has for long."""
        if self._first_left:
            self._first_left -= 1
        elif not self.readers:
            self._frames.clear()
            return
        if len(self._frames) < _LONGEST:
            self._frames.append(data)
        self.send_if_due(now_ns - _LATE_NS)

    def send_if_due(self, now_ns: int) -> None:
        """Send what is kept if the last batch is long enough ago: for moments in which nobody waits."""
        if self._frames and self.readers and now_ns >= self._due_ns:
            self._due_ns = now_ns + _GAP_NS
            self._send()

    def close(self) -> None:
        """Send what is kept and close the socket: how a force went to zero is in the last frames."""
        if self._frames and self.readers:
            self._send()
        self._socket.close(linger=_LINGER_MS)

    def _send(self) -> None:
        self._socket.send_multipart(join(self._frames), zmq.NOBLOCK)
        self._frames.clear()
