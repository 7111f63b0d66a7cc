"""A handle that was recorded: angles from a csv file or a rig's recording, no torque."""

from __future__ import annotations

import math

import numpy as np

from services.gateway import driver
from services.gateway.driver import GraspHandle, Place
from services.gateway.drivers.replay import ReplaySettings
from services.gateway.recording import read_hand
from services.gateway.servo_arrays import HANDLE_ANGLE, HANDLE_RATE
from services.mechanics.arrays import FloatArray
from services.runtime.rig import DriverSettings

_TICK_S = 1e-3


class Driver(GraspHandle):
    """Reads ``time_s`` and ``handle_angle_rad``. The recording begins with the first read."""

    has_force = False
    max_torque_nm = 1.0

    def __init__(self, settings: DriverSettings, place: Place) -> None:
        self._settings = driver.read_settings(ReplaySettings, settings, place)
        self._place = place
        self._times: FloatArray = np.zeros(1)
        self._angles: FloatArray = np.zeros(1)
        self._began_ns = 0

    def open(self) -> None:
        """Read the file."""
        table = read_hand(self._settings.file, ("time_s", "handle_angle_rad"), self._place)
        self._times = table["time_s"] - table["time_s"][0]
        self._angles = np.ascontiguousarray(table["handle_angle_rad"])

    def enable(self) -> None:
        """Nothing to switch on: `ready` stays false."""

    def read(self, time_ns: int, handle: FloatArray) -> None:
        """Write angle and rate of the recording, linear between its rows."""
        self._began_ns = self._began_ns or time_ns
        time_s, end_s = (time_ns - self._began_ns) * 1e-9, float(self._times[-1])
        if self._settings.loop and end_s > 0.0:
            time_s = math.fmod(time_s, end_s)
        here = np.interp(time_s, self._times, self._angles)
        handle[HANDLE_ANGLE] = here
        handle[HANDLE_RATE] = (here - np.interp(time_s - _TICK_S, self._times, self._angles)) / _TICK_S

    def write(self, torque_nm: float) -> None:
        """Ignore the torque: `has_force` says so."""

    def close(self) -> None:
        """Nothing to give up."""
