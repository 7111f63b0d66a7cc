"""Opening one arm: its identity, its sensors, and the memory for its frames."""

from __future__ import annotations

import ctypes
import math
from dataclasses import dataclass

import numpy as np

from trocar.services.gateway.devices.clock import Clock
from trocar.services.gateway.hdapi import cells
from trocar.services.gateway.hdapi.cells import ArmCell, Functions, Port
from trocar.services.gateway.hdapi.constants import STYLES, Parameter, Style
from trocar.services.gateway.hdapi.handover import Box
from trocar.services.gateway.hdapi.library import HdapiLibrary
from trocar.services.gateway.servo.pose import pack_mount
from trocar.services.gateway.servo.velocity_filter import butterworth
from trocar.services.runtime.config.rig import Mount, Vector3


@dataclass(frozen=True, slots=True)
class ArmTerms:
    """Limits and placement of an arm.

    Attributes:
        centre_m: Middle of the workspace in the axes of the library: right, up, toward the user.
        mount: Placement of the arm in the world.
        delay_s: Longest time that the arm's interface adds from a motion to the force that answers it.
    """

    max_force_n: float
    max_force_rate_n_s: float
    velocity_filter_hz: float
    centre_m: Vector3
    mount: Mount
    delay_s: float = 0.0


@dataclass(slots=True)
class OpenArm:
    """An arm served by the scheduler.

    Attributes:
        model: str. Model and serial number reported by the device.
        style: Style. Its calibration style.
        nominal_max_force_n: float. Largest force reported by the device.
        has_roll: bool. Whether it measures the stylus' roll.
    """

    cell: ArmCell
    port: Port
    model: str
    style: Style
    nominal_max_force_n: float
    has_roll: bool


def open_arm(library: HdapiLibrary, name: str | None, terms: ArmTerms, where: str) -> OpenArm:
    """Open the device named `name` in the vendor's set-up, motors off. The scheduler must be stopped.

    Raises DeviceError: one sentence, if it is missing.
    """
    handle = library.open_device(name, where)
    c = library.c
    c.hdMakeCurrentDevice(handle)
    model = f"{library.string(Parameter.MODEL_TYPE)} {library.string(Parameter.SERIAL_NUMBER)}"
    nominal = library.doubles(Parameter.NOMINAL_MAX_FORCE)
    has_roll = library.integer(Parameter.INPUT_DOF) == 6
    styles = library.integer(Parameter.CALIBRATION_STYLE) or 0
    style = next((style for style in STYLES if styles & style), Style.AUTO)
    c.hdBeginFrame(handle)
    has_temperature = library.doubles(Parameter.MOTOR_TEMPERATURE) is not None
    has_roll = has_roll and library.doubles(Parameter.CURRENT_GIMBAL_ANGLES) is not None
    c.hdEndFrame(handle)
    library.take_error()
    cell = _cell(terms, handle=handle, style=int(style), has_temperature=has_temperature, has_gimbal=has_roll)
    port = Port.zeros(orders=cell.orders, seen=cell.seen)
    return OpenArm(cell, port, model, style, nominal[0] if nominal else math.inf, has_roll)


def _cell(terms: ArmTerms, **of_the_device: int) -> ArmCell:
    numbers, integers = np.zeros(cells.NUMBERS), np.zeros(8, np.int32)
    return ArmCell.zeros(
        orders=Box.zeros(n=cells.ORDER_SIZE),
        seen=Box.zeros(n=cells.SEEN_SIZE),
        numbers=numbers,
        integers=integers,
        numbers_at=numbers.ctypes.data,
        integers_at=integers.ctypes.data,
        centre_m=np.array(terms.centre_m),
        mount=pack_mount(terms.mount),
        filter=butterworth(terms.velocity_filter_hz),
        max_force_n=terms.max_force_n,
        max_force_rate_n_s=terms.max_force_rate_n_s,
        cut_off_hz=terms.velocity_filter_hz,
        delay_s=terms.delay_s,
        period_ns=1e6,
        **of_the_device,
    )


def find_functions(library: HdapiLibrary, clock: Clock) -> Functions:
    """Return the functions called by the callback, of the library and of a clock."""
    return Functions(
        make_current=library.address("hdMakeCurrentDevice"),
        begin_frame=library.address("hdBeginFrame"),
        end_frame=library.address("hdEndFrame"),
        enable=library.address("hdEnable"),
        disable=library.address("hdDisable"),
        get_integers=library.address("hdGetIntegerv"),
        get_doubles=library.address("hdGetDoublev"),
        set_doubles=library.address("hdSetDoublev"),
        get_error=library.address("hdGetError"),
        check_calibration=library.address("hdCheckCalibration"),
        update_calibration=library.address("hdUpdateCalibration"),
        clock_gettime=_clock_address(clock),
    )


def _clock_address(clock: Clock) -> int:
    """Return the address of C's ``clock_gettime``, or of a test bench's simulated clock."""
    own: int | None = getattr(clock, "gettime_address", None)
    if own is not None:
        return own
    return ctypes.cast(ctypes.CDLL(None).clock_gettime, ctypes.c_void_p).value or 0
