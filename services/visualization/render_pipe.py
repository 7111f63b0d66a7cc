"""Messages between the view and its drawing processes: one letter, a length, bytes."""

from __future__ import annotations

import asyncio
import struct
from collections.abc import Iterator

HELLO, FRAME, RENDER, IMAGE = b"H", b"F", b"R", b"I"
#: Window messages: notice of the rig's state; opened, picture painted (its sequence as eight bytes), closed.
NOTICE, OPEN, PAINTED, CLOSED = b"N", b"O", b"P", b"C"
READ_BYTES = 1 << 20  # Linux: the most that a pipe of a user can hold (pipe-max-size)
_HEAD = struct.Struct("<cI")


def pack(kind: bytes, data: bytes) -> bytes:
    """Return a message."""
    return _HEAD.pack(kind, len(data)) + data


async def read_message(stream: asyncio.StreamReader) -> tuple[bytes, bytes]:
    """Return kind and bytes of the next message. Raises asyncio.IncompleteReadError if the stream ends first."""
    kind, length = _HEAD.unpack(await stream.readexactly(_HEAD.size))
    return kind, await stream.readexactly(length)


class Splitter:
    """Splits a stream of bytes into messages."""

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, data: bytes) -> Iterator[tuple[bytes, bytes]]:
        """Yield kind and bytes of every message that `data` completes."""
        self._rest += data
        while len(self._rest) >= _HEAD.size:
            kind, length = _HEAD.unpack_from(self._rest)
            end = _HEAD.size + length
            if len(self._rest) < end:
                return
            message, self._rest = self._rest[_HEAD.size : end], self._rest[end:]
            yield kind, message
