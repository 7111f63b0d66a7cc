"""Values of msgpack in the bytes of a frame, read by kernels: where what follows begins, -1 for what is not there."""

from __future__ import annotations

from typing import Any

from services.mechanics.compiled import kernel


@kernel
def big_endian(data: Any, at: int, n: int) -> int:
    """Return n bytes as a number, the most significant first."""
    value = 0
    for k in range(n):
        value = value << 8 | int(data[at + k])
    return value


@kernel
def integer(data: Any, at: int, end: int) -> tuple[int, int]:
    """Return an integer and where what follows it is; -1 where there is none, or one beyond 63 bits."""
    head = int(data[at]) if 0 <= at < end else 0xC1
    if head < 0x80:
        return head, at + 1
    if head >= 0xE0:
        return head - 256, at + 1
    if head < 0xCC or head > 0xD3:
        return 0, -1
    n = 1 << (head & 3)
    if at + 1 + n > end:
        return 0, -1
    value = big_endian(data, at + 1, n)
    if head < 0xD0:
        return value, -1 if value < 0 else at + 1 + n
    if n < 8 and value >> (8 * n - 1):
        value -= 1 << (8 * n)
    return value, at + 1 + n


@kernel
def count(data: Any, at: int, end: int, few: int, mask: int, first: int, least: int, most: int) -> tuple[int, int]:
    """Return the length that the head of something says, and where it begins; -1 for another head.

    `few` are the upper bits of a head that holds the length itself, `first` the head with a length of one byte, and
    lengths of 2**least to 2**most bytes are there.
    """
    head = int(data[at]) if 0 <= at < end else 0xC1
    if few and head & ~mask & 0xFF == few:
        return head & mask, at + 1
    n = 1 << max(0, min(3, head - first))
    if head < first + least or head > first + most or at + 1 + n > end:
        return 0, -1
    return big_endian(data, at + 1, n), at + 1 + n


@kernel
def array_head(data: Any, at: int, end: int) -> tuple[int, int]:
    """Return how many items an array has, and where the first begins."""
    return count(data, at, end, 0x90, 0x0F, 0xDB, 1, 2)


@kernel
def word_head(data: Any, at: int, end: int) -> tuple[int, int]:
    """Return how many bytes a string has, and where they begin."""
    return count(data, at, end, 0xA0, 0x1F, 0xD9, 0, 2)


@kernel
def bytes_head(data: Any, at: int, end: int) -> tuple[int, int]:
    """Return how many bytes there are, and where they begin."""
    return count(data, at, end, 0, 0, 0xC4, 0, 2)


@kernel
def is_ascii(data: Any, at: int, n: int) -> bool:
    """Return whether none of n bytes has its highest bit set."""
    upper = 0
    for k in range(n):
        upper |= data[at + k] & 0x80
    return upper == 0


@kernel
def word(data: Any, at: int, end: int, longest: int) -> tuple[int, int]:
    """Return length and beginning of a word of ASCII letters, each of which is one byte; -1 for any other."""
    length, at = word_head(data, at, end)
    if at < 0 or at + length > end or length > longest:
        return 0, -1
    return length, at if is_ascii(data, at, length) else -1
