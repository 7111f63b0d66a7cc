"""Scripted motion of an instrument: breakpoints in time, joined by minimum-jerk motions."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.scene.minimum_jerk import minimum_jerk
from trocar.services.runtime.config import config
from trocar.services.runtime.config.rig import Settings, Vector3
from trocar.services.runtime.errors import ConfigError

# Columns of a sampled script.
HIP, ROLL, HANDLE, COLUMNS = 0, 3, 4, 5
#: Name of the script that stands for the scene's own motions, see `scene_hands`.
SCENE = "scene"


class Breakpoint(Settings):
    """Pose of the tool at a time, at which it is at rest."""

    time_s: Annotated[float, Field(ge=0.0)]
    hip_m: Vector3 = Field(description="junction of shaft and jaws in the world, or the point that the motion names")
    roll_rad: float = 0.0
    handle_rad: float = Field(1.0, description="opening of the handle, 0 shut")


class Motion(Settings):
    """Motion of one hand."""

    beyond_hip_m: Annotated[float, Field(ge=0.0)] = Field(
        0.0, description="the breakpoints are for the point this far beyond the junction of shaft and jaws"
    )
    breakpoints: Annotated[tuple[Breakpoint, ...], Field(min_length=1)]

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        times = [point.time_s for point in self.breakpoints]
        if any(b <= a for a, b in pairwise(times)):
            raise ValueError("breakpoints must be in the order of their times")
        return self


class Script(Settings):
    """Motions by instrument name; with `loop` the script repeats after its last breakpoint."""

    loop: bool = True
    motions: dict[str, Motion]


class Player:
    """Samples one motion of a script at any time, played at a pace: 0.5 takes twice as long.

    Attributes:
        lasts_s: float. Time of the last breakpoint.
        repeats: bool. Whether it repeats then, or holds still.
        times, values: (k,) and (k, COLUMNS) float64. The breakpoints, for the point `beyond_m` beyond the junction; the
            tool turns about `port`.
        value, rate: (COLUMNS,) float64. Junction in the world, roll, handle, and their rates, at the last `sample`.
    """

    def __init__(self, motion: Motion, loop: bool, port_m: Vector3, pace: float = 1.0) -> None:
        points = motion.breakpoints
        self.beyond_m = motion.beyond_hip_m
        self.port = np.array(port_m)
        self.times = np.array([point.time_s for point in points]) / pace
        self.values = np.array([[*point.hip_m, point.roll_rad, point.handle_rad] for point in points])
        self.lasts_s = float(self.times[-1])
        self.repeats = loop and self.lasts_s > 0.0
        self.value = np.zeros(COLUMNS)
        self.rate = np.zeros(COLUMNS)
        self.sample(0.0)

    def sample(self, time_s: float) -> None:
        """Write position and rate at `time_s` since the script's start into `value` and `rate`."""
        minimum_jerk(self.times, self.values, self.within(time_s), self.value, self.rate)
        if self.beyond_m > 0.0:
            draw_back(self.port, self.beyond_m, self.value, self.rate)

    def within(self, time_s: float) -> float:
        """Return the time on the breakpoints' scale of `time_s` since the script's start."""
        return time_s % self.lasts_s if self.repeats else time_s


def read_player(name: str, instrument: str, port_m: Vector3, pace: float = 1.0) -> Player:
    """Return the motion of an instrument in a script of configs/scripts.

    Raises ConfigError if the script cannot be read or has no motion for the instrument.
    """
    path = config.find("script", name)
    script = config.load(Script, path)[0]
    if instrument not in script.motions:
        known = ", ".join(script.motions)
        raise ConfigError(f"{path}: motions: there is none for instrument {instrument!r}; known: {known}")
    return Player(script.motions[instrument], script.loop, port_m, pace)


@kernel
def draw_back(port: FloatArray, offset: float, value: FloatArray, rate: FloatArray) -> None:
    """Convert position and velocity of a tool's point `offset` beyond its junction to those of the junction, in place.

    J = P - l d with the shaft's direction d from the port to P, which turns as P moves.
    """
    x, y, z = value[0] - port[0], value[1] - port[1], value[2] - port[2]
    length = math.sqrt(x * x + y * y + z * z)
    x, y, z = x / length, y / length, z / length
    along = x * rate[0] + y * rate[1] + z * rate[2]
    value[0] -= offset * x
    value[1] -= offset * y
    value[2] -= offset * z
    rate[0] -= offset * (rate[0] - along * x) / length
    rate[1] -= offset * (rate[1] - along * y) / length
    rate[2] -= offset * (rate[2] - along * z) / length
