"""Bounds of the numbers in rig and device files: beyond them a number means nothing, and a sentence says why."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from pydantic import AfterValidator


@dataclass(frozen=True, slots=True)
class Bounds:
    """Least and most of a number, both allowed, their unit, and the reason of both."""

    least: float
    most: float
    unit: str
    why: str

    def __call__(self, value: float) -> float:
        """Return the value. Raises ValueError if it is out of bounds."""
        if self.least <= value <= self.most:
            return value
        side, bound = ("less", self.least) if value < self.least else ("more", self.most)
        raise ValueError(f"{self._shown(value)} is {side} than {self._shown(bound)}: {self.why}")

    def _shown(self, value: float) -> str:
        number = str(value) if isinstance(value, int) else f"{value:g}"
        return f"{number} {self.unit}" if self.unit else number


def between(least: float, most: float, unit: str, why: str) -> AfterValidator:
    """Return a validator of a number, whose message has the unit and the reason of the bound."""
    return AfterValidator(Bounds(least, most, unit, why))


Share = Annotated[float, between(0.0, 1.0, "", "it is a share")]
Core = Annotated[int, between(0, 511, "", "no host of a rig has so many cores, and they are counted from 0")]
Priority = Annotated[
    int, between(1, 89, "", "SCHED_FIFO begins at 1, and from 90 on a loop would delay the kernel's work")
]
Port = Annotated[int, between(0, 65_535, "", "TCP has no other ports; 0 takes a free one")]
Metres = Annotated[float, between(-10.0, 10.0, "m", "all of a rig stands in one room, round the world's origin")]
Turn = Annotated[float, between(-6.3, 6.3, "rad", "a whole turn either way is every direction")]
Torque = Annotated[float, between(1e-4, 5.0, "N m", "the servo gives a handle no more, and a hand feels no less")]
Pace = Annotated[
    float, between(1e-3, 100.0, "", "a thousandth is as good as still, and no hand is a hundred times as fast")
]
