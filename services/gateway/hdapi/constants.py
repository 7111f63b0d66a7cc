"""Constants of HDAPI 3.x (``HD/hdDefines.h``, ``HD/hdScheduler.h``), and explanations of its errors for operators."""

from __future__ import annotations

from enum import IntEnum

# Codes by OpenHaptics' header hdDefines.h:
INVALID_HANDLE = 0xFFFFFFFF
CALLBACK_DONE, CALLBACK_CONTINUE = 0, 1
MAX_SCHEDULER_PRIORITY = 65535


class Parameter(IntEnum):
    """Parameters of a device that can be read or set."""

    CURRENT_BUTTONS = 0x2000
    CURRENT_POSITION = 0x2050  # mm: right, up, toward the user
    CURRENT_GIMBAL_ANGLES = 0x2150  # rad; the third: stylus about its axis, clockwise
    MODEL_TYPE = 0x2501
    SERIAL_NUMBER = 0x2504
    INPUT_DOF = 0x2553
    CALIBRATION_STYLE = 0x2555
    NOMINAL_MAX_FORCE = 0x2603  # N
    MOTOR_TEMPERATURE = 0x2605  # three or six, 0 coldest to 1 warmest, predicted
    CURRENT_FORCE = 0x2700  # N


FORCE_OUTPUT = 0x4000  # by OpenHaptics' header hdDefines.h, as all codes here


class Calibration(IntEnum):
    """Results of ``hdCheckCalibration``."""

    OK = 0x5000
    NEEDS_UPDATE = 0x5001
    NEEDS_MANUAL_INPUT = 0x5002


class Style(IntEnum):
    """Calibration styles of a device, as bits."""

    ENCODER_RESET = 1
    AUTO = 2
    INKWELL = 4


#: In the order of preference.
STYLES = (Style.AUTO, Style.INKWELL, Style.ENCODER_RESET)

# Codes by OpenHaptics' header hdDefines.h:
WARM_MOTORS = 0x0200
#: Force was refused in this frame; the device continues. ``hduIsForceError`` includes warm motors.
FIRST_REFUSAL, LAST_REFUSAL = 0x0201, 0x0204
#: The library has dropped the arm, as it does when one on USB is unplugged; its handle is invalid.
BAD_HANDLE = 0x0104
#: The arm is unreachable; further frames would only wait for it.
FIRST_LINK_ERROR, LAST_LINK_ERROR = 0x0300, 0x0303
#: Errors of the scheduler, not of one arm.
TIMER_ERROR, INVALID_PRIORITY, SCHEDULER_FULL = 0x0304, 0x0500, 0x0501

ERRORS = {
    0x0100: ("HD_INVALID_ENUM", "the library does not know what it was asked"),
    0x0101: ("HD_INVALID_VALUE", "the library does not accept a value"),
    0x0102: ("HD_INVALID_OPERATION", "not possible at this moment"),
    0x0103: ("HD_INVALID_INPUT_TYPE", "the library does not accept the type of a value"),
    0x0104: ("HD_BAD_HANDLE", "the library does not know this device any more"),
    0x0200: ("HD_WARM_MOTORS", "motors are too warm"),
    0x0201: ("HD_EXCEEDED_MAX_FORCE", "more force than the device can bear was asked for"),
    0x0202: ("HD_EXCEEDED_MAX_FORCE_IMPULSE", "force rose faster than the library allows"),
    0x0203: ("HD_EXCEEDED_MAX_VELOCITY", "the arm moves faster than the library allows"),
    0x0204: ("HD_FORCE_ERROR", "the device cannot apply force"),
    0x0300: ("HD_DEVICE_FAULT", "look at the device, its power and its cable"),
    0x0301: ("HD_DEVICE_ALREADY_INITIATED", "another program uses it, or one has ended without giving it up"),
    0x0302: ("HD_COMM_ERROR", "the device does not answer: look at its cable and its power"),
    0x0303: ("HD_COMM_CONFIG_ERROR", "the device cannot be reached as it was set up: run the vendor's set-up again"),
    0x0304: ("HD_TIMER_ERROR", "the library's timer failed"),
    0x0400: ("HD_ILLEGAL_BEGIN", "a frame was begun twice"),
    0x0401: ("HD_ILLEGAL_END", "a frame was ended twice"),
    0x0402: ("HD_FRAME_ERROR", "a call was made outside its frame"),
    0x0500: ("HD_INVALID_PRIORITY", "the scheduler does not accept the priority"),
    0x0501: ("HD_SCHEDULER_FULL", "the scheduler is full"),
    0x0600: ("HD_INVALID_LICENSE", "OpenHaptics has no valid licence"),
}


def describe(code: int) -> str:
    """Return name and meaning of an error."""
    name, meaning = ERRORS.get(code, (f"HD error 0x{code:04X}", "see the manual of OpenHaptics"))
    return f"{name} ({meaning})"
