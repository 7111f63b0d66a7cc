"""ctypes binding of ``libdhd.so``: the functions that the gateway needs, with their types and their errors."""

from __future__ import annotations

import ctypes
from ctypes import POINTER, c_bool, c_byte, c_char_p, c_double, c_int, c_ubyte, c_uint, c_ushort
from enum import IntEnum
from typing import Any

from trocar.services.gateway.devices.vendor_library import declare_functions, load_library
from trocar.services.runtime.errors import DeviceError

#: File name by the vendor's SDK, with or without its links.
DEFAULT = "libdhd.so"
_ALTERNATIVES = ("libdhd.so.3", "libdrd.so.3", "libdrd.so")
#: Longer than any version's list of states.
_STATES = 32
_NUMBER = POINTER(c_double)

_SIGNATURES: dict[str, tuple[Any, tuple[Any, ...]]] = {
    "dhdErrorGetLast": (c_int, ()),
    "dhdErrorGetLastStr": (c_char_p, ()),
    "dhdGetDeviceCount": (c_int, ()),
    "dhdOpenID": (c_int, (c_byte,)),
    "dhdClose": (c_int, (c_byte,)),
    "dhdGetSerialNumber": (c_int, (POINTER(c_ushort), c_byte)),
    "dhdGetSystemName": (c_char_p, (c_byte,)),
    "dhdEnableForce": (c_int, (c_ubyte, c_byte)),
    "dhdSetGravityCompensation": (c_int, (c_int, c_byte)),
    "dhdGetStatus": (c_int, (POINTER(c_int), c_byte)),
    "dhdHasWrist": (c_bool, (c_byte,)),
    "dhdHasGripper": (c_bool, (c_byte,)),
    "dhdHasActiveGripper": (c_bool, (c_byte,)),
    "dhdGetButtonMask": (c_uint, (c_byte,)),
    "dhdGetPosition": (c_int, (_NUMBER, _NUMBER, _NUMBER, c_byte)),
    "dhdGetOrientationFrame": (c_int, (_NUMBER, c_byte)),
    "dhdGetGripperAngleRad": (c_int, (_NUMBER, c_byte)),
    "dhdSetForceAndTorqueAndGripperForce": (c_int, (*(7 * (c_double,)), c_byte)),
}


class State(IntEnum):
    """Places in the list of states."""

    POWER = 0
    CONNECTED = 1
    CALIBRATED = 3
    FORCE = 5
    ERROR = 9


class Library:
    """A loaded DHD. The C functions are attributes of `c`, with their types.

    Raises DeviceError: one sentence, if it cannot be loaded or lacks a function.
    """

    def __init__(self, path: str, where: str) -> None:
        self.path = path
        self.c: Any = _load(path, where)
        try:
            declare_functions(self.c, _SIGNATURES)
        except AttributeError as error:
            raise DeviceError(f"{where}: {path} is no DHD of version 3.7 or newer: {error}") from None

    def error(self) -> str:
        """Return the newest error of this thread, in the library's words."""
        text = self.c.dhdErrorGetLastStr()
        return text.decode(errors="replace") if text else "unknown error"

    def open_device(self, serial: int | None, where: str) -> int:
        """Return the handle of the device with this serial number; None for the only one.

        Raises DeviceError: one sentence.
        """
        count = int(self.c.dhdGetDeviceCount())
        handles = [handle for k in range(max(0, count)) if (handle := int(self.c.dhdOpenID(k))) >= 0]
        if not handles:
            why = f": {self.error()}" if count else ""
            raise DeviceError(
                f"{where}: no arm of Force Dimension or Novint can be opened{why}; `trocar doctor` says more"
            )
        serials = {handle: self.serial_number(handle) for handle in handles}
        chosen = [handle for handle in handles if serial in (None, serials[handle])]
        for handle in handles:
            if len(chosen) != 1 or handle != chosen[0]:
                self.c.dhdClose(handle)
        listed = ", ".join(map(str, serials.values()))
        if not chosen:
            raise DeviceError(f"{where}: there is no arm with serial number {serial}; there are: {listed}")
        if len(chosen) > 1:
            raise DeviceError(
                f"{where}: several arms are plugged in ({listed}): name one by its `serial` in the settings"
            )
        return chosen[0]

    def serial_number(self, handle: int) -> int:
        """Return a device's serial number, 0 if it tells none."""
        number = c_ushort()
        return int(number.value) if self.c.dhdGetSerialNumber(ctypes.byref(number), handle) >= 0 else 0

    def name(self, handle: int) -> str:
        """Return the device's model."""
        text = self.c.dhdGetSystemName(handle)
        return text.decode(errors="replace") if text else "?"

    def states(self, handle: int) -> list[int] | None:
        """Return the list of states, None if there is none."""
        states = (c_int * _STATES)()
        return list(states) if self.c.dhdGetStatus(states, handle) >= 0 else None


def _load(path: str, where: str) -> ctypes.CDLL:
    try:
        return load_library((path, *(_ALTERNATIVES if path == DEFAULT else ())))
    except OSError as error:
        raise DeviceError(
            f"{where}: Force Dimension's DHD cannot be loaded: {error}; `trocar doctor` of this rig says what to do"
        ) from None
