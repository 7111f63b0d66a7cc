"""One exchange with a device: a force to it, its state from it, in the thread that serves it."""

from __future__ import annotations

import ctypes
import math
from ctypes import c_double
from dataclasses import dataclass

from trocar.services.gateway.dhd.library import DhdLibrary, DhdState
from trocar.services.runtime.config.rig import Vector3

#: Exchanges from one look at the states to the next, which only a person changes: as long as an order is trusted.
_LOOK_EVERY = 20
_FRAME = 9  # a rotation matrix, row by row


@dataclass(frozen=True, slots=True)
class DhdSample:
    """What a device told; None: nothing.

    Attributes:
        turn_rad: Turn of its handle about itself.
        angle_rad: Opening of its gripper.
        limp: Whether it bears no force.
    """

    place_m: Vector3 | None
    turn_rad: float | None
    angle_rad: float | None
    buttons: int
    calibrated: bool | None
    problem: str
    prompt: str
    limp: bool


class DhdDevice:
    """An open device, used by one thread at a time."""

    def __init__(self, library: DhdLibrary, handle: int) -> None:
        self.library, self.handle = library, handle
        self.has_wrist = bool(library.c.dhdHasWrist(handle))
        self.has_gripper = bool(library.c.dhdHasGripper(handle))
        self.gripper_pushes = bool(library.c.dhdHasActiveGripper(handle))
        self._numbers = (c_double * 3)()
        self._frame = (c_double * _FRAME)()
        self._angle = c_double()
        at = ctypes.addressof(self._numbers)
        self._places = [ctypes.cast(at + 8 * k, ctypes.POINTER(c_double)) for k in range(3)]
        self._turns = 0
        self._motors = False
        self._states: list[int] | None = []

    def push(self, force_n: Vector3, grip_n: float) -> str:
        """Give forces; return why it was not done."""
        done = self.library.c.dhdSetForceAndTorqueAndGripperForce(*force_n, 0.0, 0.0, 0.0, grip_n, self.handle)
        return "" if done >= 0 else f"takes no force: {self.library.error()}"

    def switch(self, on: bool) -> str:
        """Switch the motors; return why it was not done."""
        if on == self._motors:
            return ""
        if self.library.c.dhdEnableForce(int(on), self.handle) < 0:
            return f"does not switch its motors: {self.library.error()}"
        self._motors = on
        return ""

    def read_sample(self) -> DhdSample:
        """Read the device."""
        c, handle = self.library.c, self.handle
        if self._turns % _LOOK_EVERY == 0:
            self._states = self.library.states(handle)
        self._turns += 1
        problem, prompt = self._judge()
        told = c.dhdGetPosition(*self._places, handle) >= 0
        if not told:
            problem = problem or f"does not tell where it is: {self.library.error()}"
        x, y, z = self._numbers
        place = None if problem else (x, y, z)
        buttons = int(c.dhdGetButtonMask(handle)) & 0xFFFF
        calibrated = None if self._states is None else self._is(DhdState.CALIBRATED)
        limp = bool(problem) or not self._is(DhdState.FORCE)
        return DhdSample(place, self._read_turn(), self._opening(), buttons, calibrated, problem, prompt, limp)

    def _is(self, state: DhdState) -> bool:
        return bool(self._states and self._states[state] == 1)

    def _judge(self) -> tuple[str, str]:
        if self._states is None:
            return f"tells no state: {self.library.error()}", ""
        if not self._is(DhdState.CONNECTED):
            return "is not plugged in", ""
        if not self._is(DhdState.POWER):
            return "has no power: plug in its supply", ""
        if self._states[DhdState.ERROR]:
            return "reports an error: switch it off and on", ""
        if self._motors and not self._is(DhdState.FORCE):
            return "", "bears no force: press its force button"
        return "", ""

    def _read_turn(self) -> float | None:
        if not self.has_wrist or self.library.c.dhdGetOrientationFrame(self._frame, self.handle) < 0:
            return None
        frame = list(self._frame)
        sine, cosine = frame[7] - frame[5], 1.0 + frame[0] + frame[4] + frame[8]
        return (
            2.0 * math.atan2(sine, cosine) if math.hypot(sine, cosine) > 1e-3 and math.isfinite(sine + cosine) else None
        )

    def _opening(self) -> float | None:
        if not self.has_gripper or self.library.c.dhdGetGripperAngleRad(ctypes.byref(self._angle), self.handle) < 0:
            return None
        angle = abs(self._angle.value)  # a left hand's is negative
        return angle if math.isfinite(angle) else None
