"""The jaws of an instrument in a hand that is told how far to open them. No torque is felt."""

from __future__ import annotations

from abc import abstractmethod
from typing import Annotated

from pydantic import Field

from services.gateway.driver import GraspHandle, Place
from services.gateway.servo_arrays import HANDLE_ANGLE, HANDLE_RATE
from services.gateway.slew import slew
from services.mechanics.arrays import FloatArray
from services.runtime.rig import Settings


class HandGraspSettings(Settings):
    """Of the rig file: how far the handle opens, and how quickly it follows."""

    start_rad: Annotated[float, Field(ge=0.0, le=1.5)] = Field(1.0, description="until somebody takes it")
    shut_rad: Annotated[float, Field(ge=0.0, le=1.5)] = Field(0.0, description="as far as it is closed")
    open_rad: Annotated[float, Field(ge=0.0, le=1.5)] = Field(1.2, description="as far as it is opened")
    rate_rad_s: Annotated[float, Field(gt=0.0, le=10.0)] = 1.0


class HandGrasp(GraspHandle):
    """Follows an opening at a hand's pace. What the opening is, a driver says in `opening`."""

    has_force = False
    max_torque_nm = 0.3

    def __init__(self, settings: HandGraspSettings, place: Place) -> None:
        self.place = place
        self._settings = settings
        self._angle = self._target = settings.start_rad
        self._last_ns = 0

    def begin_again(self) -> None:
        """Open or shut the handle as it was until somebody took it."""
        self._angle = self._target = self._settings.start_rad

    def open(self) -> None:
        """Compile the limiter here, and not in a tick."""
        slew(self._angle, self._target, 0.0)

    def enable(self) -> None:
        """Nothing to switch on: `ready` stays false."""

    @abstractmethod
    def opening(self, time_ns: int) -> float | None:
        """Return how far to open, 0 (shut) to 1; None leaves it as it is. Never waits."""

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
        """Ignore the torque: `has_force` says so."""

    def close(self) -> None:
        """Nothing to give up."""
