"""Firmware of an ODrive: 0.6 is told from 0.5 by the answer to Get_Version and by what heartbeats hold.

Both have the same identifiers, but firmware 0.5 has other errors, in other bits. It does not answer Get_Version, and
bytes 5 to 7 of its heartbeat are flags of motor, encoder and controller, where 0.6 has the result of a procedure, one
flag and zero.
"""

from __future__ import annotations

import struct

from trocar.services.gateway.can import cansimple

NEEDED = (0, 6)  # the firmware whose frames `cansimple` has
_OLD = (0, 5)  # the firmware that is told by its heartbeat, without an answer to Get_Version
#: Errors of firmware 0.5 whose bits are unused in 0.6: sensorless, homing, over-temperature, unknown position.
_OLD_ERRORS = 0x80 | 0x20000 | 0x40000 | 0x80000


class FirmwareCheck:
    """What is known of one drive's firmware.

    Attributes:
        version: (major, minor) of the drive's answer; None before it.
    """

    def __init__(self) -> None:
        self.version: tuple[int, int] | None = None
        self._has_old_heartbeat = False  # one that firmware 0.6 does not send
        self._is_clean = True  # whether the newest means the same in both

    def take_version(self, data: bytes) -> None:
        """Take the answer to Get_Version; one of another length is ignored."""
        try:
            self.version = cansimple.unpack_version(data)[:2]
        except struct.error:
            return

    def take_heartbeat(self, data: bytes) -> None:
        """Take the payload of a heartbeat, of eight bytes."""
        errors, _ = cansimple.unpack_heartbeat(data)
        self._has_old_heartbeat |= data[7] != 0 or data[6] > 1 or bool(errors & _OLD_ERRORS)
        self._is_clean = errors == 0 and not any(data[5:])

    @property
    def is_needed(self) -> bool:
        """Whether the drive has told the needed version, and nothing contradicts it."""
        return self.version == NEEDED and not self._has_old_heartbeat

    @property
    def is_wrong(self) -> bool:
        """Whether the drive has another version, by its answer or, without one, by its heartbeats."""
        if self.version is None:
            return self._has_old_heartbeat or not self._is_clean
        return not self.is_needed

    @property
    def problem(self) -> str:
        """Empty if it is the needed one, else of the drive: "speaks firmware 0.5, 0.6 is needed"."""
        if self.is_needed:
            return ""
        if not self.is_wrong:
            return "does not tell its firmware (Get_Version), as 0.5 does not: 0.6 is needed"
        major, minor = _OLD if self.version is None or self.version == NEEDED else self.version
        return f"speaks firmware {major}.{minor}, {NEEDED[0]}.{NEEDED[1]} is needed"
