"""What the hand on an emulated handle wants: a recording, a script, or a slow squeeze."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np

from services.runtime.errors import ConfigError

#: Angle of the handle at a time.
Wanted = Callable[[float], float]

_COLUMN = "handle_angle_rad"
_RECORDING_HZ = 1000.0


def squeeze(time_s: float) -> float:
    """Return a slow squeeze between open (1 rad) and nearly shut (0.1 rad), every 4 s."""
    return 0.55 + 0.45 * math.cos(2 * math.pi * time_s / 4.0)


def scripted(name: str, instrument: str) -> Wanted:
    """Return the handle angles of a script of configs/scripts."""
    from services.gateway.script import HANDLE, read_player  # only here: its kernels take a second to import

    player = read_player(name, instrument, (0.0, 0.0, 0.0))  # the handle does not care where the port is

    def wanted(time_s: float) -> float:
        player.sample(time_s)
        return float(player.value[HANDLE])

    return wanted


def recorded(path: Path) -> Wanted:
    """Return the handle angles of a 1 kHz recording, played forwards and back so that it never jumps.

    Raises
    ------
    ConfigError
        if the file cannot be read or has no column ``handle_angle_rad`` of finite numbers.
    """
    try:
        table = np.genfromtxt(path, delimiter=",", names=True)
    except (OSError, ValueError) as error:
        raise ConfigError(f"{path}: {error}") from None
    names = table.dtype.names or ()
    if _COLUMN not in names or not np.isfinite(table[_COLUMN]).all():
        raise ConfigError(f"{path}: needs a column {_COLUMN} of finite numbers; it has {', '.join(names) or 'none'}")
    angles = table[_COLUMN].tolist()
    there_and_back = angles + angles[-2:0:-1]

    def wanted(time_s: float) -> float:
        return float(there_and_back[int(time_s * _RECORDING_HZ) % len(there_and_back)])

    return wanted
