"""What the hand on an emulated handle wants: a recording, a script, or a slow squeeze."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from services.gateway.recording import read_table

if TYPE_CHECKING:
    from services.gateway.script import Player

#: Angle of the handle at a time.
Wanted = Callable[[float], float]

_NO_PORT = (0.0, 0.0, 0.0)  # the handle does not care where the port is
_COLUMN = "handle_angle_rad"
_RECORDING_HZ = 1000.0


def squeeze(time_s: float) -> float:
    """Return a slow squeeze between open (1 rad) and nearly shut (0.1 rad), every 4 s."""
    return 0.55 + 0.45 * math.cos(2 * math.pi * time_s / 4.0)


def scripted(name: str, instrument: str, pace: float = 1.0) -> Wanted:
    """Return the handle angles of a script of configs/scripts."""
    from services.gateway.script import read_player  # only here: its kernels take a second to import

    return _played(read_player(name, instrument, _NO_PORT, pace))


def of_scenario(name: str, index: int, pace: float = 1.0) -> Wanted:
    """Return the handle angles of a scenario of the mechanics."""
    from services.gateway.scenario_script import scenario_player

    return _played(scenario_player(name, index, _NO_PORT, pace))


def _played(player: Player) -> Wanted:
    from services.gateway.script import HANDLE

    def wanted(time_s: float) -> float:
        player.sample(time_s)
        return float(player.value[HANDLE])

    return wanted


def fitted(wanted: Wanted, range_rad: tuple[float, float]) -> Wanted:
    """Return `wanted`, which moves between shut (0) and open (1 rad), moving between two other angles."""
    low, high = range_rad

    def between(time_s: float) -> float:
        return low + (high - low) * min(max(wanted(time_s), 0.0), 1.0)

    return between


def recorded(path: Path) -> Wanted:
    """Return the handle angles of a 1 kHz recording, played forwards and back so that it never jumps.

    Raises
    ------
    DeviceError
        if the file cannot be used.
    """
    table = read_table(path, (_COLUMN,))
    angles = table[_COLUMN].tolist()
    there_and_back = angles + angles[-2:0:-1]

    def wanted(time_s: float) -> float:
        return float(there_and_back[int(time_s * _RECORDING_HZ) % len(there_and_back)])

    return wanted
