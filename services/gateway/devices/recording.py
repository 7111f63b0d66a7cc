"""Recordings of devices: csv files with a header line and one row per sample, in SI units, or recordings of a rig."""

from __future__ import annotations

import math
import warnings
from pathlib import Path

import numpy as np
import numpy.typing as npt

from trocar.protocol.topics import TICK_S
from trocar.services.gateway.devices.driver import Place
from trocar.services.gateway.servo.pose import pack_mount, to_arm
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.recordings.errors import RecordingError
from trocar.services.runtime.errors import ConfigError

_DTYPE = [(name, np.float64) for name in ("time_s", "x_m", "y_m", "z_m", "roll_rad", "handle_angle_rad")]


class Track:
    """Columns of a recording at the time since the first read, linear between rows; repeated with `loop`."""

    def __init__(self, times_s: FloatArray, *columns: FloatArray, loop: bool) -> None:
        self._times_s, self._columns = times_s - times_s[0], columns
        self._end_s = float(self._times_s[-1]) if loop else 0.0
        self._began_ns = 0

    def at(self, time_ns: int) -> tuple[list[float], list[float]]:
        """Return each column, and its rate over the last tick."""
        self._began_ns = self._began_ns or time_ns
        time_s = (time_ns - self._began_ns) * 1e-9
        if self._end_s > 0.0:
            time_s = math.fmod(time_s, self._end_s)
        here, before = (
            [float(np.interp(t, self._times_s, c)) for c in self._columns] for t in (time_s, time_s - TICK_S)
        )
        return here, [(now - then) / TICK_S for now, then in zip(here, before, strict=True)]


def read_hand(path: Path, columns: tuple[str, ...], place: Place) -> npt.NDArray[np.void]:
    """Return a hand's motion as `read_table` does, from a csv file or from a rig's recording of this instrument.

    Positions are in the frame of the arm, wherever the recorded arm was mounted. A recording ends where its gateway was
    restarted.
    Raises RecordingError naming the file, if it is invalid.
    """
    if path.suffix != ".mcap":
        return read_table(path, columns)
    from trocar.services.recordings.reader import read_messages  # not installed with every gateway

    mount, at_arm, rows = pack_mount(place.mount), np.zeros(3), list[tuple[float, ...]]()
    for _topic, _time_ns, state in read_messages(path, ("gateway.state",)):
        time_s = 1e-3 * state.tick
        if rows and time_s < rows[-1][0]:
            break
        if rows and time_s == rows[-1][0]:  # the rig's time was stopped
            continue
        for hand in state.instruments:
            if hand.name == place.instrument:
                to_arm(np.array(hand.position_m) - mount[2:], 0, mount, at_arm, 0)
                rows.append((time_s, *at_arm.tolist(), hand.roll_rad, hand.handle_angle_rad))
    if len(rows) < 2:
        raise RecordingError(f"{path}: holds no two frames of an instrument {place.instrument!r}")
    return np.array(rows, _DTYPE)


def read_table(path: Path, columns: tuple[str, ...]) -> npt.NDArray[np.void]:
    """Return a csv file with a header line as a structured array of at least two rows, ordered by time.

    Raises ConfigError naming the file, if it cannot be opened, RecordingError if it lacks one of `columns`, contains
    anything but finite numbers, or if a column ``time_s`` does not increase.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
        if not any(line.strip() for line in lines):
            raise RecordingError(f"{path}: the file is empty")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a file of only a header is reported below
            table: npt.NDArray[np.void] = np.atleast_1d(np.genfromtxt(lines, delimiter=",", names=True))
    except OSError as error:
        raise ConfigError(f"{path}: {(error.strerror or str(error)).lower()}") from None
    except (ValueError, IndexError) as error:
        raise RecordingError(f"{path}: is not a csv file with a header line: {' '.join(str(error).split())}") from None
    names = table.dtype.names or ()
    missing = [column for column in columns if column not in names]
    if missing:
        raise RecordingError(f"{path}: there is no column {missing[0]}; there are {', '.join(names) or 'none'}")
    if len(table) < 2:
        raise RecordingError(f"{path}: needs two rows or more of finite numbers, has {len(table)}")
    for name in names:
        wrong = np.flatnonzero(~np.isfinite(table[name]))
        if len(wrong):
            raise RecordingError(f"{path}: row {wrong[0] + 1} below the header: {name} is not a finite number")
    if "time_s" in names and (np.diff(table["time_s"]) <= 0.0).any():
        raise RecordingError(f"{path}: time_s must increase")
    return table
