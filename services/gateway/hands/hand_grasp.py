"""The jaws of an instrument in a virtual hand that follows a commanded opening, without torque."""

from __future__ import annotations

from abc import abstractmethod
from typing import Annotated

from pydantic import Field

from trocar.services.gateway.devices.driver import GraspHandle, Place
from trocar.services.gateway.servo.servo_arrays import HANDLE_ANGLE, HANDLE_RATE
from trocar.services.gateway.servo.slew import slew
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.runtime.config.bounds import between
from trocar.services.runtime.config.rig import Settings

_OPENING = between(0.0, 1.5, "rad", "a handle is shut at 0, and no jaws open wider")


class HandGraspSettings(Settings):
    """Settings in the rig file: range and rate of the handle."""

    start_rad: Annotated[float, _OPENING] = Field(1.0, description="opening until somebody takes it")
    shut_rad: Annotated[float, _OPENING] = Field(0.0, description="opening of the closed handle")
    open_rad: Annotated[float, _OPENING] = Field(1.2, description="opening of the open handle")
    rate_rad_s: Annotated[float, between(0.01, 10.0, "rad/s", "no hand is faster, and jaws have to move")] = 1.0


class HandGrasp(GraspHandle):
    """Follows an opening at a limited rate. Drivers return the opening from `opening`."""

    has_force = False
    max_torque_nm = 0.3

    def __init__(self, settings: HandGraspSettings, place: Place) -> None:
        self.place = place
        self._settings = settings
        self._angle = self._target = settings.start_rad
        self._last_ns = 0

    def begin_again(self) -> None:
        """Reset the handle to its initial opening."""
        self._angle = self._target = self._settings.start_rad

    def open(self) -> None:
        """Compile the rate limiter before the first tick."""
        slew(self._angle, self._target, 0.0)

    def enable(self) -> None:
        """Do nothing: there are no motors, and `ready` stays false."""

    @abstractmethod
    def opening(self, time_ns: int) -> float | None:
        """Return the commanded opening, 0 (shut) to 1, or None to keep the last. Never waits."""

    def read(self, time_ns: int, handle: FloatArray) -> None:
        """Write angle and rate."""
        opening = self.opening(time_ns)
        if opening is not None:
            shut, wide = self._settings.shut_rad, self._settings.open_rad
            self._target = shut + min(max(opening, 0.0), 1.0) * (wide - shut)
        passed_s = (time_ns - self._last_ns) * 1e-9 if self._last_ns else 0.0
        self._last_ns = time_ns
        step = self._settings.rate_rad_s * min(passed_s, 0.02)
        before, self._angle = self._angle, slew(self._angle, self._target, step)
        moved = self._angle - before
        handle[HANDLE_ANGLE] = self._angle
        handle[HANDLE_RATE] = moved / passed_s if passed_s > 0.0 else 0.0

    def write(self, torque_nm: float) -> None:
        """Ignore the torque, as `has_force` is false."""

    def close(self) -> None:
        """Do nothing: there is no device."""
