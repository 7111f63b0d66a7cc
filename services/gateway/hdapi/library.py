"""ctypes binding of ``libHD.so``: the functions that the gateway needs, with their types and their errors."""

from __future__ import annotations

import ctypes
from ctypes import POINTER, c_char_p, c_double, c_int, c_uint, c_ulong, c_ushort, c_void_p
from typing import Any

from trocar.services.gateway.devices.vendor_library import declare_functions, load_library
from trocar.services.gateway.hdapi.constants import INVALID_HANDLE, Parameter, describe
from trocar.services.runtime.errors import DeviceError

#: File name by the vendor's installer, with or without its links.
DEFAULT = "libHD.so"
_ALTERNATIVES = ("libHD.so.3.4", "libHD.so.3.0.0", "libHD.so.3")
#: More than the library's stack holds, in case it never reports that it is empty.
_MOST_ERRORS = 256

_SIGNATURES: dict[str, tuple[Any, tuple[Any, ...]]] = {
    "hdInitDevice": (c_uint, (c_char_p,)),
    "hdDisableDevice": (None, (c_uint,)),
    "hdMakeCurrentDevice": (None, (c_uint,)),
    "hdBeginFrame": (None, (c_uint,)),
    "hdEndFrame": (None, (c_uint,)),
    "hdEnable": (None, (c_uint,)),
    "hdDisable": (None, (c_uint,)),
    "hdGetIntegerv": (None, (c_uint, POINTER(c_int))),
    "hdGetDoublev": (None, (c_uint, POINTER(c_double))),
    "hdSetDoublev": (None, (c_uint, POINTER(c_double))),
    "hdGetString": (c_char_p, (c_uint,)),
    "hdCheckCalibration": (c_uint, ()),
    "hdUpdateCalibration": (None, (c_uint,)),
    "hdScheduleAsynchronous": (c_ulong, (c_void_p, c_void_p, c_ushort)),
    "hdUnschedule": (None, (c_ulong,)),
    "hdSetSchedulerRate": (None, (c_ulong,)),
    "hdStartScheduler": (None, ()),
    "hdStopScheduler": (None, ()),
}


class ErrorInfo(ctypes.Structure):
    """Result of ``hdGetError``, by value."""

    _fields_ = (("code", c_uint), ("internal", c_int), ("handle", c_uint))


class Library:
    """A loaded HDAPI. The C functions are attributes of `c`, with their types.

    Raises DeviceError: one sentence, if it cannot be loaded or lacks a function.
    """

    def __init__(self, path: str, where: str) -> None:
        self.path = path
        self.c: Any = _load(path, where)
        try:
            declare_functions(self.c, _SIGNATURES)
            self.c.hdGetError.restype, self.c.hdGetError.argtypes = ErrorInfo, ()
        except AttributeError as error:
            raise DeviceError(f"{where}: {path} is no HDAPI: {error}") from None

    def address(self, name: str) -> int:
        """Return the address of a function, for compiled code that calls it."""
        return ctypes.cast(getattr(self.c, name), c_void_p).value or 0

    def take_error(self) -> int:
        """Empty the error stack; return the newest error, 0 if there was none."""
        newest = 0
        for _ in range(_MOST_ERRORS):
            code = int(self.c.hdGetError().code)
            if not code:
                break
            newest = newest or code
        return newest

    def open_device(self, name: str | None, where: str) -> int:
        """Return the handle of the device named `name` in the vendor's set-up; None for the default device.

        Raises DeviceError: one sentence.
        """
        self.take_error()
        handle = int(self.c.hdInitDevice(None if name is None else name.encode()))
        error = self.take_error()
        if error or handle == INVALID_HANDLE:
            if handle != INVALID_HANDLE:  # it was opened all the same, and would stay locked
                self.c.hdDisableDevice(handle)
                self.take_error()
            shown = "the default device" if name is None else f"device {name!r}"
            raise DeviceError(f"{where}: {shown} cannot be opened: {describe(error)}; `trocar doctor` says more")
        return handle

    def integer(self, parameter: Parameter) -> int | None:
        """Return an integer of the current device, None if it has none."""
        value = (c_int * 6)()
        self.c.hdGetIntegerv(parameter, value)
        return None if self.take_error() else value[0]

    def doubles(self, parameter: Parameter) -> list[float] | None:
        """Return up to six numbers of the current device, None if it has none."""
        value = (c_double * 16)()
        self.c.hdGetDoublev(parameter, value)
        return None if self.take_error() else list(value[:6])

    def string(self, parameter: Parameter) -> str:
        """Return a text of the current device, "?" if it has none."""
        text = self.c.hdGetString(parameter)
        return "?" if self.take_error() or not text else text.decode(errors="replace")


def _load(path: str, where: str) -> ctypes.CDLL:
    try:
        return load_library((path, *(_ALTERNATIVES if path == DEFAULT else ())))
    except OSError as error:
        raise DeviceError(
            f"{where}: OpenHaptics cannot be loaded: {error}; `trocar doctor` of this rig says what to do"
        ) from None
