"""Classic CAN frames in Linux' memory format (``struct can_frame``, 16 bytes), on any transport."""

from __future__ import annotations

import struct
from collections.abc import Iterator

SIZE = 16
EXTENDED, REMOTE = 0x80000000, 0x40000000
ADDRESS = 0x1FFFFFFF

_FRAME = struct.Struct("=IB3x8s")


def pack(identifier: int, data: bytes) -> bytes:
    """Return a frame; `identifier` includes the flags, `data` are at most eight bytes."""
    return _FRAME.pack(identifier, len(data), data)


def unpack(frames: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield the identifier with its flags, and the data, of each frame.

    Raises struct.error if the last frame is not whole.
    """
    for identifier, length, data in _FRAME.iter_unpack(frames):
        yield identifier, data[:length]
