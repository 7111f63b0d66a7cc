"""The packets between who asks for a file and who reads it.

A request is JSON with a socket for its answer. An answer is a sequence of messages, each cut into packets; the last
packet of all says how the reader ended. Packets keep their bounds (SOCK_SEQPACKET), so a reader that dies in the middle
of a message leaves no half of one. Nothing in them is executed.
"""

from __future__ import annotations

import socket

import msgspec

#: Bytes of one packet: a third of what a Unix socket of Linux takes by default. A request is one packet, an answer
#: many.
REQUEST_MAX = PACKET_MAX = 1 << 16
#: First byte of a packet: a part of a message, its last part, a refusal, how the reader ended.
PART, LAST, REFUSED, ENDED = b"+", b".", b"!", b"="


class CallRequest(msgspec.Struct, frozen=True):
    """A function of the server's module, its arguments, and what it may take."""

    function: str
    arguments: dict[str, msgspec.Raw]
    memory_bytes: int
    cpu_s: float
    nice: int


class Refused(msgspec.Struct, frozen=True):
    """Why a file is not read: the name of an exception's class, and its sentence.

    Attributes:
        is_told: Whether the sentence names the file; else it is what a library said.
        trace: Where it was raised.
    """

    kind: str
    sentence: str
    is_told: bool
    trace: str = ""


class Ended(msgspec.Struct, frozen=True):
    """How a reader ended: its exit code or, negative, its signal; and what it took."""

    code: int
    cpu_s: float
    memory_bytes: int


def send_message(sink: socket.socket, data: bytes | memoryview) -> None:
    """Send a message in packets."""
    view = memoryview(data).cast("B")
    for start in range(0, len(view), PACKET_MAX):
        end = start + PACKET_MAX
        sink.sendmsg([PART if end < len(view) else LAST, view[start:end]])
    if not view:
        sink.send(LAST)
