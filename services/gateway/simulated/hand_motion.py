"""Target angles of the hand on an emulated handle, every millisecond: a recording, a script, or a slow squeeze."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from trocar.protocol.topics import TICK_HZ
from trocar.services.gateway.devices.recording import read_table
from trocar.services.gateway.motions.scenario_script import scenario_player
from trocar.services.gateway.motions.script import COLUMNS, HANDLE, Motion, Player, read_player
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.scene.minimum_jerk import minimum_jerk

MOTION_HZ = TICK_HZ
_NO_PORT = (0.0, 0.0, 0.0)  # handle angles do not depend on the port
_COLUMN = "handle_angle_rad"
_SQUEEZE_S = 4.0  # slow: at most 0.7 rad/s, as a hand that feels its way


@dataclass(frozen=True, slots=True)
class HandMotion:
    """Angles (n,) float64 in rad at `MOTION_HZ`, repeated or held at the end."""

    angle_rad: FloatArray
    repeats: bool


def squeeze() -> HandMotion:
    """Return a slow squeeze between open (1 rad) and nearly shut (0.1 rad), every 4 s."""
    turns = np.arange(round(_SQUEEZE_S * MOTION_HZ)) / (_SQUEEZE_S * MOTION_HZ)
    return HandMotion(0.55 + 0.45 * np.cos(2 * np.pi * turns), repeats=True)


def scripted(name: str, instrument: str, pace: float = 1.0) -> HandMotion:
    """Return the handle angles of a script of configs/scripts."""
    return _sampled(read_player(name, instrument, _NO_PORT, pace))


def of_scenario(name: str, index: int, pace: float = 1.0) -> HandMotion:
    """Return the handle angles of a scenario of the mechanics."""
    return _sampled(scenario_player(name, index, _NO_PORT, pace))


def of_motion(motion: Motion, pace: float = 1.0) -> HandMotion:
    """Return the handle angles of a motion that is not repeated."""
    return _sampled(Player(motion, False, _NO_PORT, pace))


def _sampled(player: Player) -> HandMotion:
    angles = np.empty(max(1, round(player.lasts_s * MOTION_HZ) + (not player.repeats)))
    _sample_angles(player.times, player.values, MOTION_HZ, angles)
    return HandMotion(angles, player.repeats)


@kernel
def _sample_angles(times: FloatArray, values: FloatArray, rate_hz: float, out: FloatArray) -> None:
    """Write the handle's angle at each tick of a rate into ``out`` (n,); of breakpoints as in `minimum_jerk`."""
    value, rate = np.empty(COLUMNS), np.empty(COLUMNS)
    for k in range(out.shape[0]):
        minimum_jerk(times, values, k / rate_hz, value, rate)
        out[k] = value[HANDLE]


def fitted(motion: HandMotion, range_rad: tuple[float, float]) -> HandMotion:
    """Return `motion`, which moves between 0 (shut) and 1 rad (open), scaled to another range of angles."""
    low, high = range_rad
    return replace(motion, angle_rad=low + (high - low) * motion.angle_rad.clip(0.0, 1.0))


def recorded(path: Path) -> HandMotion:
    """Return the handle angles of a 1 kHz recording, played forwards and backwards so that they never jump.

    Raises RecordingError if the file is invalid.
    """
    angles = np.ascontiguousarray(read_table(path, (_COLUMN,))[_COLUMN], np.float64)
    return HandMotion(np.concatenate((angles, angles[-2:0:-1])), repeats=True)
