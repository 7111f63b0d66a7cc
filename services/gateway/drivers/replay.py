"""A recorded arm: positions from a csv file or a rig's recording, without force."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from trocar.services.gateway.devices import driver
from trocar.services.gateway.devices.driver import Arm, ArmLimits, Place
from trocar.services.gateway.devices.recording import Track, read_hand
from trocar.services.gateway.servo.servo_arrays import READ_POSITION, READ_ROLL, READ_VELOCITY
from trocar.services.gateway.simulated import premium_model
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.runtime.config.rig import DriverSettings, Settings

COLUMNS = ("time_s", "x_m", "y_m", "z_m")


class ArmReplaySettings(Settings):
    """Settings in the rig file: the recording."""

    file: Path
    loop: bool = True


class Driver(Arm):
    """Reads ``time_s, x_m, y_m, z_m`` and optionally ``roll_rad``, in the frame of the arm, or its instrument in a
    rig's recording.

    The recording starts with the first read. A recorded hand cannot react to force, so there is none.
    """

    has_force = False
    limits = ArmLimits(
        max_force_n=1.0,
        continuous_force_n=1.0,
        max_velocity_m_s=2.0,
        count_m=premium_model.COUNT_M,
        friction_n=premium_model.FRICTION_N,
        delay_s=1e-4,
    )

    def __init__(self, settings: DriverSettings, place: Place) -> None:
        self._settings = driver.read_settings(ArmReplaySettings, settings, place)
        self._place = place
        self._track = Track(np.zeros(1), *np.zeros((4, 1)), loop=False)

    def open(self) -> None:
        """Read the file."""
        table = read_hand(self._settings.file, COLUMNS, self._place)
        roll = table["roll_rad"] if "roll_rad" in (table.dtype.names or ()) else np.zeros(len(table))
        self._track = Track(*(table[name] for name in COLUMNS), roll, loop=self._settings.loop)

    def enable(self) -> None:
        """Do nothing: there are no motors."""

    def read(self, time_ns: int, reading: FloatArray) -> None:
        """Write position, velocity and roll of the recording, linear between its rows."""
        here, rates = self._track.at(time_ns)
        reading[READ_POSITION : READ_POSITION + 3] = here[:3]
        reading[READ_VELOCITY : READ_VELOCITY + 3] = rates[:3]
        reading[READ_ROLL] = here[3]

    def write(self, force_n: FloatArray) -> None:
        """Ignore the force, as `has_force` is false."""

    def close(self) -> None:
        """Do nothing: there is no device."""
