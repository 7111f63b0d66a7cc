"""Geometry of the report's figures: what the template draws, in units of their view boxes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from trocar.review.attempts.assessment import Assessment
from trocar.services.training.errors import ERRORS, ErrorEvent
from trocar.services.training.procedure import PHASES

# Pixels of a figure, so that a page of A4 or a screen has room for it; margins hold the numbers beside the axes:
WIDTH, NARROW, LEFT, RIGHT = 900.0, 420.0, 56.0, 12.0
TOP, HEIGHT, BOTTOM = 12.0, 190.0, 24.0
_LETTER, _LINE = 7.5, 15.0  # of a figure's words, of 13 pixels: at most so wide, and so high with the room between

LEAD_S = 3.0
"""A replay begins so long before an error: an assumption of what a person needs to see how it came."""


@dataclass(frozen=True, slots=True)
class Scale:
    """A straight map of values to places."""

    low: float
    high: float
    first: float
    last: float

    def __call__(self, value: float) -> float:
        """Return the place of a value."""
        span = self.high - self.low
        share = (value - self.low) / span if span > 0.0 else 0.0
        return round(self.first + share * (self.last - self.first), 2)


def ticks(low: float, high: float, most: int = 6) -> list[float]:
    """Return round values from `low` to `high`: steps of 1, 2 or 5 times a power of ten."""
    span = high - low
    if not span > 0.0:
        return [low]
    step = 10.0 ** math.floor(math.log10(span / most))
    step *= next(factor for factor in (1.0, 2.0, 5.0, 10.0, 20.0) if span / (step * factor) <= most)
    return [round(step * k, 12) for k in range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)]


@dataclass(frozen=True, slots=True)
class Chart:
    """Curves over a common axis; `marks` are lines across at a value, `beyond` the names of those out of sight.

    Their words stand beside and above the curves, as they would lie on them.
    """

    x_ticks: list[tuple[float, str]]
    y_ticks: list[tuple[float, str]]
    curves: list[tuple[str, str]]
    marks: list[tuple[float, str]]
    beyond: list[str]
    width: float
    right: float
    height: float = HEIGHT
    left: float = LEFT
    top: float = TOP
    line: float = _LINE
    bottom: float = HEIGHT - BOTTOM


def chart(
    x: Sequence[float],
    curves: Mapping[str, Sequence[float]],
    marks: Mapping[str, float] | None = None,
    x_low: float = 0.0,
    width: float = WIDTH,
) -> Chart:
    """Return curves by name over `x`; marks are in sight as long as they are not far beyond all curves."""
    values = [value for curve in curves.values() for value in curve]
    low, high = min([0.0, *values]), max(values, default=0.0)
    known = marks or {}
    shown = {name: at for name, at in known.items() if at <= 1.5 * high or high <= 0.0 or len(values) == 0}
    high = max([high, *shown.values(), 1e-9]) * 1.05
    right = width - RIGHT - max((_LETTER * len(name) for name in shown), default=0.0)
    top = TOP + _LINE * (len(known) - len(shown))
    across = Scale(x_low, max([x_low + 1e-9, *x]), LEFT, right)
    up = Scale(low, high, HEIGHT - BOTTOM, top)
    return Chart(
        x_ticks=[(across(at), f"{at:g}") for at in ticks(across.low, across.high, round(width / 90.0))],
        y_ticks=[(up(at), f"{at:g}") for at in ticks(low, high)],
        curves=[
            (name, " ".join(f"{across(a)},{up(b)}" for a, b in zip(x, curve, strict=False)))
            for name, curve in curves.items()
        ],
        marks=[(up(at), name) for name, at in shown.items()],
        beyond=[f"{name} {at:g}, above" for name, at in known.items() if name not in shown],
        width=width,
        right=right,
        top=top,
    )


@dataclass(frozen=True, slots=True)
class Marker:
    """An error on the time line."""

    x: float
    y: float
    event: ErrorEvent
    name: str


@dataclass(frozen=True, slots=True)
class Timeline:
    """Phases as bars, errors as markers above them in rows that do not cover each other."""

    bars: list[tuple[float, float, str, str]]
    markers: list[Marker]
    x_ticks: list[tuple[float, str]]
    bar_y: float
    height: float
    width: float = WIDTH


def timeline(found: Assessment) -> Timeline:
    """Return the time line of an attempt."""
    end_s = max([1e-9, found.time_s, *(span.end_s for span in found.phases)])
    across = Scale(0.0, end_s, LEFT, WIDTH - RIGHT)
    placed: list[tuple[float, int, ErrorEvent]] = []
    for event in found.errors:
        x = across(min(event.begin_s, end_s))
        taken = {row for at, row, _ in placed if abs(at - x) < 30.0}
        placed.append((x, next(row for row in range(len(placed) + 1) if row not in taken), event))
    rows = max((row for _, row, _ in placed), default=0) + 1
    bar_y = 10.0 + 20.0 * rows
    return Timeline(
        bars=[
            (across(span.begin_s), max(1.5, across(span.end_s) - across(span.begin_s)), span.phase, PHASES[span.phase])
            for span in found.phases
        ],
        markers=[Marker(x, bar_y - 14.0 - 20.0 * row, event, ERRORS[event.code][0]) for x, row, event in placed],
        x_ticks=[(across(at), f"{at:g}") for at in ticks(0.0, end_s, 10)],
        bar_y=bar_y,
        height=bar_y + 62.0,
    )
