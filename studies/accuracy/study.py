"""What a study is: settings, a converged reference, the error of each setting against it, and a tick to be timed."""

from __future__ import annotations

import pkgutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from importlib import import_module
from pathlib import Path
from typing import Protocol, TypeVar, cast

from trocar.services.mechanics.arrays import FloatArray
from trocar.studies.accuracy import sweeps

Choice = str | int | float | bool
Reference = Mapping[str, FloatArray]
Tick = Callable[[], None]
T = TypeVar("T")


class Size(StrEnum):
    """How much of a study is run."""

    SMALLEST = "smallest"
    QUICK = "quick"
    FULL = "full"


@dataclass(frozen=True, slots=True)
class Draw:
    """What a study is drawn with."""

    size: Size
    seed: int

    def pick(self, smallest: T, quick: T, full: T) -> T:
        """Return that of the three that belongs to the size."""
        return {Size.SMALLEST: smallest, Size.QUICK: quick, Size.FULL: full}[self.size]


@dataclass(frozen=True, slots=True)
class Setting:
    """One point of a study.

    Attributes:
        name: str. Tells it from all others of its study.
        choices: mapping. What was chosen, by the names that a scene file has for it where it has one.
        series: str. Settings of one series are drawn alike.
        group: str. Settings of one group are timed in turns; others would only push one another out of the caches.
    """

    name: str
    choices: Mapping[str, Choice]
    series: str = ""
    group: str = ""


@dataclass(frozen=True, slots=True)
class Error:
    """How far one quantity is from the reference.

    Attributes:
        value: float. In ``unit``; not finite where the setting did not come through.
        unit: str
        is_known: bool. False where nothing is an error, as in what an effect changes, or nothing is to be chosen
            between: such points have no frontier.
    """

    value: float
    unit: str
    is_known: bool = True


class Study(Protocol):
    """What a module of `sweeps` has."""

    TITLE: str
    WHAT: str
    """What is varied, in which situation, and what the reference is; one paragraph for the reader of the page."""

    def settings(self, draw: Draw) -> Sequence[Setting]:
        """Return the settings, cheap to list."""

    def reference(self, draw: Draw) -> Reference:
        """Return what all settings are compared with; computed once."""

    def errors(self, setting: Setting, reference: Reference, draw: Draw) -> dict[str, Error]:
        """Return the errors of a setting by quantity: the same numbers in every process."""

    def tick(self, setting: Setting, draw: Draw) -> Tick | None:
        """Return what costs time, a millisecond of the scene, ready to be called; None where nothing is timed."""


class Reads(Protocol):
    """What a study may have besides: what its numbers mean."""

    def findings(self, rows: Sequence[Row]) -> list[str]:
        """Return sentences for the page of the documentation, made from the rows."""


class DrawnOnly(Protocol):
    """What a study may have besides: series that a page of the documentation draws, and does not tabulate."""

    DRAWN_ONLY: Mapping[str, str]
    """What to call each of these series."""


class DrawsItself(Protocol):
    """What a study may have besides: a figure of its own."""

    def draw_figure(self, rows: Sequence[Row], stem: Path) -> list[Path]:
        """Draw the study as ``stem``.svg and .png and return both."""


def study_names() -> list[str]:
    """Return the names of all studies: those of the modules in `sweeps`."""
    return sorted(module.name for module in pkgutil.iter_modules(sweeps.__path__))


def load_study(name: str) -> Study:
    """Return a study. Raises ValueError if there is none of that name; the message lists those there are."""
    if name not in study_names():
        raise ValueError(f"there is no study '{name}'; known: {', '.join(study_names())}")
    return cast(Study, import_module(f"{sweeps.__name__}.{name}"))


@dataclass(frozen=True, slots=True)
class Cost:
    """Time of a millisecond of the scene, in microseconds.

    Attributes:
        median_us, p99_us: float
        noise_us: float. Half the range of the medians of interleaved repeats.
    """

    median_us: float
    p99_us: float
    noise_us: float

    def shared(self, n: int) -> Cost:
        """Return the part of each of ``n`` milliseconds that it is shared by."""
        return Cost(self.median_us / n, self.p99_us / n, self.noise_us / n)


@dataclass(frozen=True, slots=True)
class Row:
    """One line of the table: one quantity of one setting, and what the setting costs."""

    study: str
    setting: str
    series: str
    quantity: str
    error: float
    unit: str
    is_known: bool = True
    cost: Cost | None = None
    choices: Mapping[str, Choice] = field(default_factory=dict)
