"""Orders of the gateway to the process of the emulated drives, beside the frames on their buses."""

from __future__ import annotations

import msgspec


class Add(msgspec.Struct, tag=True):
    """Emulate one more drive. Two descriptors are attached: its end of the bus, and the target angles of its hand."""

    node: int
    watchdog_s: float
    repeats: bool


class GoOn(msgspec.Struct, tag=True):
    """Start the motion of a drive's hand, without torque."""

    node: int


class BeginAgain(msgspec.Struct, tag=True):
    """Reset the handle of a drive to its start, and restart its hand's motion."""

    node: int


class SetPace(msgspec.Struct, tag=True):
    """Set the pace of a drive's hand, 0 to 1."""

    node: int
    pace: float


class Ask(msgspec.Struct, tag=True):
    """Request the torque that a drive applies now; for test benches."""

    node: int


Order = Add | GoOn | BeginAgain | SetPace | Ask
LONGEST = 256  # bytes: four times an order with its numbers
DESCRIPTORS = 2  # at most: a drive's bus, and the file with its hand's angles
encode = msgspec.json.Encoder().encode
decode = msgspec.json.Decoder(Order).decode
