"""Frames as nobody sends them, drawn by chance, and what a reader of the bus makes of one."""

from __future__ import annotations

import random

from tests.protocol import samples
from trocar.protocol import TOPICS, FrameError, Reason, decode, encode
from trocar.protocol.declared import fault

#: By topic, the bytes of a frame that is as it should be.
SEEDS = {name: encode(samples.frame(name)) for name in TOPICS}
_NAMES, _ALL = list(SEEDS), list(SEEDS.values())


def garbled(chance: random.Random) -> tuple[str, bytes]:
    """Return a topic, and what comes by its socket: bytes of chance, or a frame of it that was harmed, or is whole."""
    kind, topic = chance.randrange(9), chance.choice(_NAMES)
    data = bytearray(SEEDS[topic])
    if kind == 0:
        return topic, chance.randbytes(chance.randrange(200))
    if kind == 1:
        return topic, bytes(data[: chance.randrange(len(data))])
    if kind == 2:  # msgpack headers that claim more than there is
        at = chance.randrange(len(data))
        data[at : at + 1] = chance.choice((b"\xdd", b"\xdf", b"\xc6", b"\xdb", b"\xc9")) + b"\xff\xff\xff\xff"
    elif kind == 3:
        other = chance.choice(_ALL)
        data[chance.randrange(len(data)) :] = other[chance.randrange(len(other)) :]
    elif kind == 4:  # deep nesting
        at = chance.randrange(len(data))
        data[at:at] = b"\x91" * chance.randrange(5000)
    elif kind == 5:  # numbers that are none, in an array or outside
        at, count = chance.randrange(len(data)), chance.randrange(8, 24)
        data[at : at + count] = b"\xff" * len(data[at : at + count])
    elif kind < 8:
        for _ in range(chance.randrange(1, 6)):
            data[chance.randrange(len(data))] = chance.randrange(256)
    return topic, bytes(data)


def outcome(topic: str, data: bytes) -> str:
    """Return why a reader of the topic refuses the bytes, or `valid`: then they hold what the topic declares.

    Whatever a sender would send is valid. A reader who only keeps frames refuses none that another one accepts, and
    what it accepts lacks nothing but numbers that are finite.
    """
    found = _read(topic, data, used=True)
    kept = _read(topic, data, used=False)
    assert found != "valid" or kept == "valid", f"refused, {kept}, by who only keeps it"
    assert found == "valid" or data != SEEDS[topic], f"a whole frame was refused: {found}"
    return found


def _read(topic: str, data: bytes, *, used: bool) -> str:
    try:
        frame = decode(data, topic, used=used)
    except FrameError as error:
        return Reason(error.reason)
    row = TOPICS[topic]
    assert frame.topic == topic
    assert isinstance(frame.body, row.body)
    wrong = fault(frame.body, finite_scalars=row.command and used)
    assert wrong is None or (not used and wrong[0] == Reason.NOT_FINITE), wrong
    return "valid"
