"""Values as protobuf and MCAP have them, written by kernels into a chunk: each returns where the next one goes."""

from __future__ import annotations

from typing import Any

from services.mechanics.compiled import kernel


@kernel
def put_varint(out: Any, to: int, value: int) -> int:
    """Write groups of seven bits, least first; a negative number as its 64-bit two's complement."""
    for _ in range(9):
        if 0 <= value < 0x80:
            break
        out[to] = value & 0x7F | 0x80
        value = value >> 7 & 0x1FFFFFFFFFFFFFF
        to += 1
    out[to] = value
    return to + 1


@kernel
def put_little_endian(out: Any, to: int, n: int, value: int) -> int:
    """Write a number as n bytes, the least significant first."""
    for k in range(n):
        out[to + k] = value >> (8 * k) & 0xFF
    return to + n


@kernel
def copy(data: Any, at: int, n: int, out: Any, to: int) -> None:
    """Copy n bytes, the first one first: they may overlap with where they go, before them."""
    for k in range(n):
        out[to + k] = data[at + k]


@kernel
def put_number(data: Any, at: int, end: int, out: Any, to: int) -> int:
    """Turn a double round; return where what follows it is, -1 where there is none."""
    if at < 0 or at + 9 > end or data[at] != 0xCB:
        return -1
    for k in range(8):
        out[to + k] = data[at + 8 - k]
    return at + 9


@kernel
def close(out: Any, mark: int, to: int) -> int:
    """Write the length of what begins two bytes after `mark` and ends at `to`; return where it ends then."""
    length = to - mark - 2
    n = 1 if length < 1 << 7 else 2 if length < 1 << 14 else 3
    if n == 3:
        for k in range(length - 1, -1, -1):
            out[mark + 3 + k] = out[mark + 2 + k]
    elif n == 1:
        copy(out, mark + 2, length, out, mark + 1)
    put_varint(out, mark, length)
    return mark + n + length
