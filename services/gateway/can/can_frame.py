"""Classic CAN frames in Linux' memory format (``struct can_frame``, 16 bytes), on any transport."""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterator

EXTENDED, REMOTE = socket.CAN_EFF_FLAG, socket.CAN_RTR_FLAG
ADDRESS = socket.CAN_EFF_MASK

_FRAME = struct.Struct("=IB3x8s")
SIZE = _FRAME.size


def pack(identifier: int, data: bytes) -> bytes:
    """Return a frame; `identifier` includes the flags, `data` are at most eight bytes."""
    return _FRAME.pack(identifier, len(data), data)


def unpack(frames: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield the identifier with its flags, and the data, of each frame.

    Raises struct.error if the last frame is not whole.
    """
    for identifier, length, data in _FRAME.iter_unpack(frames):
        yield identifier, data[:length]
