"""What the gateway tells the process of the emulated drives, beside the frames on their buses."""

from __future__ import annotations

import msgspec


class Add(msgspec.Struct, tag=True):
    """Emulate one more drive. With it come two descriptors: its end of the bus, and the angles that its hand wants."""

    node: int
    watchdog_s: float
    repeats: bool


class GoOn(msgspec.Struct, tag=True):
    """Let the hand of a drive begin, without torque."""

    node: int


class Ask(msgspec.Struct, tag=True):
    """Tell what torque a drive applies now: a bench asks, not a rig."""

    node: int


Order = Add | GoOn | Ask
LONGEST = 256
DESCRIPTORS = 2
encode = msgspec.json.Encoder().encode
decode = msgspec.json.Decoder(Order).decode
