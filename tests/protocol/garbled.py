"""Frames as nobody sends them, drawn by chance, and what the decoder makes of one."""

from __future__ import annotations

import random

from protocol import TOPICS, FrameError, Reason, decode, encode
from protocol.declared import fault
from tests.protocol import samples

SEEDS = [encode(samples.frame(name)) for name in TOPICS]


def garbled(chance: random.Random) -> bytes:
    """Return bytes of chance, or a frame of some topic that was cut, mixed with another, swollen or overwritten."""
    kind = chance.randrange(7)
    data = bytearray(chance.choice(SEEDS))
    if kind == 0:
        return chance.randbytes(chance.randrange(200))
    if kind == 1:
        return bytes(data[: chance.randrange(len(data))])
    if kind == 2:  # msgpack headers that claim more than there is
        at = chance.randrange(len(data))
        data[at : at + 1] = chance.choice((b"\xdd", b"\xdf", b"\xc6", b"\xdb", b"\xc9")) + b"\xff\xff\xff\xff"
    elif kind == 3:
        other = chance.choice(SEEDS)
        data[chance.randrange(len(data)) :] = other[chance.randrange(len(other)) :]
    elif kind == 4:  # deep nesting
        at = chance.randrange(len(data))
        data[at:at] = b"\x91" * chance.randrange(5000)
    else:
        for _ in range(chance.randrange(1, 6)):
            data[chance.randrange(len(data))] = chance.randrange(256)
    return bytes(data)


def outcome(data: bytes) -> str:
    """Return why the decoder refuses the bytes, or `valid`: then they hold what their topic declares."""
    try:
        frame = decode(data)
    except FrameError as error:
        return Reason(error.reason)
    row = TOPICS[frame.topic]
    assert isinstance(frame.body, row.body)
    assert fault(frame.body, finite_scalars=row.command) is None
    return "valid"
