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


class BeginAgain(msgspec.Struct, tag=True):
    """Put the handle of a drive to where its hand began; that begins once more."""

    node: int


class SetPace(msgspec.Struct, tag=True):
    """Let the hand of a drive move at this pace from now on, 0 to 1."""

    node: int
    pace: float


class Ask(msgspec.Struct, tag=True):
    """Tell what torque a drive applies now: a bench asks, not a rig."""

    node: int


Order = Add | GoOn | BeginAgain | SetPace | Ask
LONGEST = 256
DESCRIPTORS = 2
encode = msgspec.json.Encoder().encode
decode = msgspec.json.Decoder(Order).decode
