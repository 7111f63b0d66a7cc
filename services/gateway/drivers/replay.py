"""An arm that was recorded: positions from a csv file or a rig's recording, no force."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from services.gateway import driver, premium_model
from services.gateway.driver import Arm, ArmLimits, Place
from services.gateway.recording import read_hand
from services.gateway.servo_arrays import READ_POSITION, READ_ROLL, READ_VELOCITY
from services.mechanics.arrays import FloatArray
from services.runtime.rig import DriverSettings, Settings

COLUMNS = ("time_s", "x_m", "y_m", "z_m")
_TICK_S = 1e-3


class ReplaySettings(Settings):
    """Of the rig file: what is replayed."""

    file: Path
    loop: bool = True


class Driver(Arm):
    """Reads ``time_s, x_m, y_m, z_m`` and, where there is one, ``roll_rad``, in the frame of the arm; or its
    instrument in a recording of a rig.

    The recording begins with the first read. A person cannot be pushed in the past, so there is no force.
    """

    has_force = False
    limits = ArmLimits(
        max_force_n=1.0,
        continuous_force_n=1.0,
        max_velocity_m_s=2.0,
        count_m=premium_model.COUNT_M,
        friction_n=premium_model.FRICTION_N,
    )

    def __init__(self, settings: DriverSettings, place: Place) -> None:
        self._settings = driver.read_settings(ReplaySettings, settings, place)
        self._place = place
        self._times: FloatArray = np.zeros(1)
        self._values: FloatArray = np.zeros((1, 4))
        self._began_ns = 0

    def open(self) -> None:
        """Read the file."""
        table = read_hand(self._settings.file, COLUMNS, self._place)
        self._times = table["time_s"] - table["time_s"][0]
        roll = table["roll_rad"] if "roll_rad" in (table.dtype.names or ()) else np.zeros(len(table))
        self._values = np.column_stack((table["x_m"], table["y_m"], table["z_m"], roll))

    def enable(self) -> None:
        """Nothing to switch on."""

    def read(self, time_ns: int, reading: FloatArray) -> None:
        """Write position, velocity and roll of the recording, linear between its rows."""
        self._began_ns = self._began_ns or time_ns
        time_s, end_s = (time_ns - self._began_ns) * 1e-9, float(self._times[-1])
        if self._settings.loop and end_s > 0.0:
            time_s = math.fmod(time_s, end_s)
        for axis in range(3):
            here = np.interp(time_s, self._times, self._values[:, axis])
            before = np.interp(time_s - _TICK_S, self._times, self._values[:, axis])
            reading[READ_POSITION + axis] = here
            reading[READ_VELOCITY + axis] = (here - before) / _TICK_S
        reading[READ_ROLL] = np.interp(time_s, self._times, self._values[:, 3])

    def write(self, force_n: FloatArray) -> None:
        """Ignore the force: `has_force` says so."""

    def close(self) -> None:
        """Nothing to give up."""
