"""What a scripted person does with an instrument: breakpoints in time, joined by minimum-jerk motions."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from services.gateway.kernel import kernel
from services.gateway.layout import FloatArray
from services.runtime import config
from services.runtime.errors import ConfigError
from services.runtime.rig import Settings, Vector3

# Columns of a sampled script.
HIP, ROLL, HANDLE, COLUMNS = 0, 3, 4, 5


class Breakpoint(Settings):
    """Where the hand holds the tool at a time; it comes to rest there."""

    time_s: Annotated[float, Field(ge=0.0)]
    hip_m: Vector3 = Field(description="junction of shaft and jaws, in the world")
    roll_rad: float = 0.0
    handle_rad: float = Field(1.0, description="opening of the handle, 0 shut")


class Motion(Settings):
    """What one hand does."""

    breakpoints: Annotated[tuple[Breakpoint, ...], Field(min_length=1)]

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        times = [point.time_s for point in self.breakpoints]
        if any(b <= a for a, b in pairwise(times)):
            raise ValueError("breakpoints must be in the order of their times")
        return self


class Script(Settings):
    """Motions by instrument name. With `loop` the script begins again after its last breakpoint."""

    loop: bool = True
    motions: dict[str, Motion]


class Player:
    """Samples one motion of a script at any time."""

    def __init__(self, motion: Motion, loop: bool) -> None:
        points = motion.breakpoints
        self._times = np.array([point.time_s for point in points])
        self._values = np.array([[*point.hip_m, point.roll_rad, point.handle_rad] for point in points])
        self._loop = loop
        self.value = np.zeros(COLUMNS)
        self.rate = np.zeros(COLUMNS)
        self.sample(0.0)

    def sample(self, time_s: float) -> None:
        """Write position and rate at `time_s` since the script's begin into `value` and `rate`."""
        end = float(self._times[-1])
        if self._loop and end > 0.0:
            time_s %= end
        minimum_jerk(self._times, self._values, time_s, self.value, self.rate)


def read_player(name: str, instrument: str) -> Player:
    """Return the motion of an instrument in a script of configs/scripts.

    Raises
    ------
    ConfigError
        if the script cannot be read or has no motion for the instrument.
    """
    path = config.find("script", name)
    script = config.load(Script, path)[0]
    if instrument not in script.motions:
        known = ", ".join(script.motions)
        raise ConfigError(f"{path}: motions: there is none for instrument {instrument!r}; known: {known}")
    return Player(script.motions[instrument], script.loop)


@kernel
def minimum_jerk(times: FloatArray, values: FloatArray, time: float, value: FloatArray, rate: FloatArray) -> None:
    """Write values and rates at `time` of breakpoints joined by quintics that rest at both ends.

    Source: Flash and Hogan, J. Neuroscience 5(7), 1985: s = 10 u^3 - 15 u^4 + 6 u^5.
    """
    last = len(times) - 1
    k = 0
    while k < last - 1 and time >= times[k + 1]:
        k += 1
    after = min(k + 1, last)
    span = times[after] - times[k]
    u = min(1.0, max(0.0, (time - times[k]) / span)) if span > 0.0 else 1.0
    s = u * u * u * (10.0 + u * (6.0 * u - 15.0))
    ds = 30.0 * u * u * (1.0 - u) * (1.0 - u) / span if span > 0.0 else 0.0
    for i in range(len(value)):
        change = values[after, i] - values[k, i]
        value[i] = values[k, i] + s * change
        rate[i] = ds * change
