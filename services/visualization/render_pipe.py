"""Messages between the view and its render worker: one letter, a length, bytes."""

from __future__ import annotations

import asyncio
import struct
from typing import BinaryIO

HELLO, FRAME, RENDER, IMAGE = b"H", b"F", b"R", b"I"
_HEAD = struct.Struct("<cI")


def pack(kind: bytes, data: bytes) -> bytes:
    """Return a message."""
    return _HEAD.pack(kind, len(data)) + data


def read(stream: BinaryIO) -> tuple[bytes, bytes] | None:
    """Return kind and bytes of the next message, None at the end of the stream."""
    head = stream.read(_HEAD.size)
    if len(head) < _HEAD.size:
        return None
    kind, length = _HEAD.unpack(head)
    return kind, stream.read(length)


async def read_message(stream: asyncio.StreamReader) -> bytes:
    """Return the bytes of the next message.

    Raises
    ------
    asyncio.IncompleteReadError
        if the stream ends first.
    """
    _, length = _HEAD.unpack(await stream.readexactly(_HEAD.size))
    return await stream.readexactly(length)
