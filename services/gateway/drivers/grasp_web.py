"""The jaws of an instrument in the hand of a person at the page. No torque is felt."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

from pydantic import Field

from services.gateway import driver
from services.gateway.bench import Bench, no_output
from services.gateway.driver import GraspHandle, Place
from services.gateway.drivers.web import hand_of
from services.gateway.layout import HANDLE_ANGLE, HANDLE_RATE
from services.mechanics.arrays import FloatArray
from services.runtime.rig import DriverSettings, Settings


class WebGraspSettings(Settings):
    """Of the rig file: how far the handle opens, and how quickly it follows."""

    start_rad: Annotated[float, Field(ge=0.0, le=1.5)] = Field(1.0, description="until somebody takes it")
    shut_rad: Annotated[float, Field(ge=0.0, le=1.5)] = Field(0.0, description="as far as the page closes it")
    open_rad: Annotated[float, Field(ge=0.0, le=1.5)] = Field(1.2, description="as far as the page opens it")
    rate_rad_s: Annotated[float, Field(gt=0.0, le=10.0)] = 1.0


class Driver(GraspHandle):
    """Follows the opening in `visualization.hands` at a hand's pace."""

    has_force = False
    max_torque_nm = 0.3

    def __init__(self, settings: DriverSettings, place: Place) -> None:
        self._settings = driver.read_settings(WebGraspSettings, settings, place)
        self._place = place
        self._angle = self._target = self._settings.start_rad
        self._last_ns = 0

    def open(self) -> None:
        """Nothing to open."""

    def enable(self) -> None:
        """Nothing to switch on: `ready` stays false."""

    def read(self, time_ns: int, handle: FloatArray) -> None:
        """Write angle and rate."""
        hand = hand_of(self._place)
        if hand is not None and hand.opening >= 0.0:
            shut, wide = self._settings.shut_rad, self._settings.open_rad
            self._target = shut + min(hand.opening, 1.0) * (wide - shut)
        passed_s = (time_ns - self._last_ns) * 1e-9 if self._last_ns else 0.0
        self._last_ns = time_ns
        step = self._settings.rate_rad_s * min(passed_s, 0.02)
        moved = min(max(self._target - self._angle, -step), step)
        self._angle += moved
        handle[HANDLE_ANGLE] = self._angle
        handle[HANDLE_RATE] = moved / passed_s if passed_s > 0.0 else 0.0

    def write(self, torque_nm: float) -> None:
        """Ignore the torque: `has_force` says so."""

    def close(self) -> None:
        """Nothing to give up."""


@contextmanager
def bench(_folder: Path) -> Iterator[Bench]:
    """Nobody is at the page: the handle waits."""
    yield Bench(DriverSettings(driver="grasp_web"), output=no_output)
