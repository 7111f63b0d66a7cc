"""ODrive CANSimple, firmware 0.6: identifiers and payloads, both directions; ``configs/devices/odrive.dbc`` agrees.

An identifier is ``node << 5 | command``; payloads are little-endian.
"""

from __future__ import annotations

import struct
from enum import IntEnum, IntFlag

# Commands by ODrive's documentation of CANSimple:
GET_VERSION, HEARTBEAT, ESTOP, GET_ERROR = 0x00, 0x01, 0x02, 0x03
SET_AXIS_STATE, GET_ENCODER_ESTIMATES, SET_CONTROLLER_MODE = 0x07, 0x09, 0x0B
SET_INPUT_TORQUE, SET_LIMITS, GET_TEMPERATURE, CLEAR_ERRORS, GET_TORQUES = 0x0E, 0x0F, 0x15, 0x18, 0x1C

#: Period of heartbeats as a drive is delivered (firmware 0.6).
HEARTBEAT_S = 0.1
MAX_NODE = 0x3E  # 0x3F is a drive without a number
CONTROL_TORQUE, INPUT_PASSTHROUGH = 1, 1  # modes by the same documentation

_HEARTBEAT = struct.Struct("<IBBBx")
_VERSION = struct.Struct("<BBBBBBBB")
_TWO_FLOATS = struct.Struct("<ff")
_FLOAT = struct.Struct("<f")
_WORD = struct.Struct("<I")
_TWO_WORDS = struct.Struct("<II")


class AxisState(IntEnum):
    """States of an axis that are used here."""

    IDLE = 1
    CLOSED_LOOP = 8


class AxisError(IntFlag):
    """Errors that can occur on this rig."""

    DC_BUS_OVER_VOLTAGE = 0x100
    DC_BUS_UNDER_VOLTAGE = 0x200
    CURRENT_LIMIT = 0x1000
    MOTOR_OVER_TEMPERATURE = 0x2000
    INVERTER_OVER_TEMPERATURE = 0x4000
    VELOCITY_LIMIT = 0x8000
    POSITION_LIMIT = 0x10000
    WATCHDOG_TIMER_EXPIRED = 0x1000000
    ESTOP_REQUESTED = 0x2000000
    SPINOUT = 0x4000000


def error_names(errors: int) -> str:
    """Return the names of the bits of `errors`; unnamed bits are in hexadecimal."""
    known = [flag for flag in AxisError if errors & flag]
    rest = errors & ~sum(known)
    return ", ".join([flag.name or "" for flag in known] + ([f"{rest:#x}"] if rest else []))


def identifier(node: int, command: int) -> int:
    """Return the arbitration id of a command to or from `node`."""
    return node << 5 | command


def command(arbitration_id: int) -> int:
    """Return the command of an arbitration id."""
    return arbitration_id & 0x1F


def pack_heartbeat(errors: int, state: int, procedure_result: int, trajectory_done: bool) -> bytes:
    """Return the payload of a heartbeat."""
    return _HEARTBEAT.pack(errors, state, procedure_result, trajectory_done)


def unpack_heartbeat(data: bytes) -> tuple[int, int]:
    """Return errors and axis state of a heartbeat. Raises struct.error if the payload has another length."""
    errors, state, _, _ = _HEARTBEAT.unpack(data)
    return errors, state


def pack_version(major: int, minor: int, revision: int) -> bytes:
    """Return the payload of the answer to Get_Version: protocol 2, hardware 5.2.0, and this firmware, released."""
    return _VERSION.pack(2, 5, 2, 0, major, minor, revision, 0)


def unpack_version(data: bytes) -> tuple[int, int, int]:
    """Return major, minor and revision of the firmware. Raises struct.error if the payload has another length."""
    _, _, _, _, major, minor, revision, _ = _VERSION.unpack(data)
    return major, minor, revision


def pack_floats(first: float, second: float) -> bytes:
    """Return two floats: encoder estimates (turns, turns/s), limits (turns/s, A), torques (N m) or temperatures."""
    return _TWO_FLOATS.pack(first, second)


def unpack_floats(data: bytes) -> tuple[float, float]:
    """Return the two floats of a payload."""
    first, second = _TWO_FLOATS.unpack(data)
    return first, second


def pack_float(value: float) -> bytes:
    """Return one float: an input torque in N m."""
    return _FLOAT.pack(value)


def unpack_float(data: bytes) -> float:
    """Return the float of a payload."""
    return float(_FLOAT.unpack(data)[0])


def pack_word(value: int) -> bytes:
    """Return one word: an axis state."""
    return _WORD.pack(value)


def pack_words(first: int, second: int) -> bytes:
    """Return two words: a controller mode (control, input), or errors (active, disarm reason)."""
    return _TWO_WORDS.pack(first, second)


def unpack_words(data: bytes) -> tuple[int, ...]:
    """Return the words of a payload of four or eight bytes."""
    return (_TWO_WORDS if len(data) == _TWO_WORDS.size else _WORD).unpack(data)
