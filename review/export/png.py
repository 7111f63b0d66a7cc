"""A grey picture as a PNG file, without a package for pictures."""

from __future__ import annotations

import struct
import zlib

import numpy as np
import numpy.typing as npt

_HEAD = b"\x89PNG\r\n\x1a\n"
_EIGHT_BITS_GREY = bytes((8, 0, 0, 0, 0))


def grey_png(grey: npt.NDArray[np.uint8]) -> bytes:
    """Return a picture (height, width) as a file of PNG; ISO/IEC 15948."""
    height, width = grey.shape
    rows = np.concatenate([np.zeros((height, 1), np.uint8), grey], axis=1)  # each line begins with its filter: none
    size = struct.pack(">II", width, height)
    parts = ((b"IHDR", size + _EIGHT_BITS_GREY), (b"IDAT", zlib.compress(rows.tobytes())), (b"IEND", b""))
    return _HEAD + b"".join(_chunk(kind, data) for kind, data in parts)


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
