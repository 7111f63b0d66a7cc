"""A recorded handle: angles from a csv file or a rig's recording, without torque."""

from __future__ import annotations

import numpy as np

from trocar.services.gateway.devices import driver
from trocar.services.gateway.devices.driver import GraspHandle, Place
from trocar.services.gateway.devices.recording import Track, read_hand
from trocar.services.gateway.drivers.replay import ArmReplaySettings
from trocar.services.gateway.servo.servo_arrays import HANDLE_ANGLE, HANDLE_RATE
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.runtime.config.rig import DriverSettings


class Driver(GraspHandle):
    """Reads ``time_s`` and ``handle_angle_rad``. The recording begins with the first read."""

    has_force = False
    max_torque_nm = 1.0

    def __init__(self, settings: DriverSettings, place: Place) -> None:
        self._settings = driver.read_settings(ArmReplaySettings, settings, place)
        self._place = place
        self._track = Track(np.zeros(1), np.zeros(1), loop=False)

    def open(self) -> None:
        """Read the file."""
        table = read_hand(self._settings.file, ("time_s", "handle_angle_rad"), self._place)
        self._track = Track(table["time_s"], table["handle_angle_rad"], loop=self._settings.loop)

    def enable(self) -> None:
        """Do nothing: there are no motors, and `ready` stays false."""

    def read(self, time_ns: int, handle: FloatArray) -> None:
        """Write angle and rate of the recording, linear between its rows."""
        (handle[HANDLE_ANGLE],), (handle[HANDLE_RATE],) = self._track.at(time_ns)

    def write(self, torque_nm: float) -> None:
        """Ignore the torque, as `has_force` is false."""

    def close(self) -> None:
        """Do nothing: there is no device."""
