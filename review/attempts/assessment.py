"""All that is known of an attempt once it has ended: what is stored, reported and compared."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import msgspec
import numpy as np

from trocar.protocol.topics import TICK_S
from trocar.review.attempts.trace import Columns
from trocar.services.training.errors import ErrorEvent
from trocar.services.training.procedure import Span
from trocar.services.training.score import Score

_SERIES_HZ = 10.0  # as many points as a figure of 900 pixels can show of 90 s
_DIGITS = 6  # micrometres of a metre: finer than anything that was measured
_EARLIER_S = 0.1
"""How much before its end an attempt is looked at, because a recording may end with it: a rig judges each 83 ms."""
FAULTS_ABOVE = 3
"""How many faults of the rig `Assessment.why_not` names, so that it stays a sentence; `RigQuality.faults` has all."""


class RigQuality(msgspec.Struct, frozen=True, kw_only=True):
    """How well the rig kept its word: shares are of ticks, ages of the force model that the hand felt.

    Attributes:
        faults: What the supervisor said while it was degraded or stopped; sentences that differ in numbers are one.
        model_age_ms: 99th percentile; None where no device felt a force.
    """

    lost_ticks: float = 0.0
    largest_gap_s: float = 0.0
    model_age_ms: float | None = None
    lowest_quality_level: int = 0
    has_force: bool = True
    faults: tuple[str, ...] = ()


class Series(msgspec.Struct, frozen=True, kw_only=True):
    """Curves for the report, some a second, each with a value at each time: in s, lengths in mm, forces in N."""

    time_s: list[float] = []
    inserted_mm: list[float] = []
    loads_n: dict[str, list[float]] = {}
    tissues_n: dict[str, list[float]] = {}
    paths_mm: dict[str, list[tuple[float, float, float]]] = {}


class Assessment(msgspec.Struct, frozen=True, kw_only=True):
    """One attempt. `outcome` is success, failure, abandoned, or incomplete: the recording ends before the attempt.

    Attributes:
        began_ns, began_at_s: Its first motion: by the wall clock, and since the first device frame of the recording.
        why_not: Why it does not count; nothing where it does.
        par: What the simulated hands reach at the scenario, by metric.
        not_judged: What could not be told from the recording.
        from_tick: The rig's tick at second 0; -1 if unknown.
        simulated_time, slowest: Whether late ticks slowed the rig's time down, and its slowest speed against the clock.
        examined: Whether nobody helped: no hint, and no word of an error before the end.
    """

    attempt_id: str
    scenario: str
    title: str
    outcome: str
    reason: str
    source: str
    began_ns: int
    began_at_s: float
    version: str
    why_not: tuple[str, ...]
    time_s: float
    time_limit_s: float
    goal_depth_m: float
    depth_max_m: float
    phases: list[Span]
    errors: list[ErrorEvent]
    metrics: dict[str, float]
    limits: dict[str, float]
    score: Score | None
    rig: RigQuality
    bookmarks_s: tuple[float, ...] = ()
    par: dict[str, float] = {}
    not_judged: tuple[str, ...] = ()
    series: Series = Series()
    from_tick: int = -1
    simulated_time: bool = False
    slowest: float = 1.0
    examined: bool = False

    @property
    def counts(self) -> bool:
        """Whether it is compared with others."""
        return not self.why_not and self.outcome in ("success", "failure")

    @property
    def last_moment(self) -> tuple[int, int]:
        """Rig's tick shortly before its end, -1 if unknown, and the wall-clock time, too early if ticks were slow."""
        end_s = max(self.time_s - _EARLIER_S, 0.0)
        tick = self.from_tick + round(end_s / TICK_S) if self.from_tick >= 0 else -1
        return tick, self.began_ns + round(1e9 * end_s)


def series_of(columns: Columns, tissues: Iterable[str]) -> Series:
    """Return the curves of an attempt, thinned: of forces the largest of each interval, of places the first."""
    if not len(columns.time_s):
        return Series()
    edges = np.unique(np.searchsorted(columns.time_s, np.arange(0.0, columns.time_s[-1] + 1e-9, 1.0 / _SERIES_HZ)))
    edges = edges[edges < len(columns.time_s)]
    places = np.searchsorted(columns.way_s, columns.time_s[edges]).clip(max=max(len(columns.way_s) - 1, 0))
    paths = {"tip": columns.tip_m[edges]}
    if len(columns.way_s):
        paths |= {name: columns.position_m[places, k] for k, name in enumerate(columns.names)}
    peak = np.maximum.reduceat
    return Series(
        time_s=_rounded(columns.time_s[edges]),
        inserted_mm=_rounded(1e3 * columns.inserted_m[edges]),
        loads_n={name: _rounded(peak(columns.load_n[:, k], edges)) for k, name in enumerate(columns.names)},
        tissues_n={name: _rounded(peak(columns.tissue_n[:, k], edges)) for k, name in enumerate(tissues)},
        paths_mm={
            name: [(x, y, z) for x, y, z in (_rounded(1e3 * point) for point in path)] for name, path in paths.items()
        },
    )


def _rounded(values: Iterable[float]) -> list[float]:
    return [float(f"{value:.{_DIGITS}g}") for value in values]


def metric_label(name: str) -> str:
    """Return a metric's name without its unit."""
    owner, _, end = name.rpartition(".")
    end = end.removesuffix(next((tail for tail in ("_m", *_UNITS) if end.endswith(tail)), ""))
    return f"{owner}: {end}".removeprefix(": ").replace("_", " ")


def metric_words(metrics: Mapping[str, float]) -> dict[str, tuple[float, str]]:
    """Return each metric as it is shown: value and unit, lengths in mm, shares in percent."""
    shown: dict[str, tuple[float, str]] = {}
    for name, value in metrics.items():
        end = name.rpartition(".")[2]
        if end.endswith("_m"):
            shown[name] = 1e3 * value, "mm"
        elif end.endswith("_share"):
            shown[name] = 100.0 * value, "%"
        else:
            shown[name] = value, next((unit for tail, unit in _UNITS.items() if end.endswith(tail)), "")
    return shown


_UNITS = {"_n_s": "N s", "_s": "s", "_hz": "Hz", "_rad": "rad", "_n": "N"}
