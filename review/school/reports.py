"""Data of attempts for a trainee; the page makes sentences of them, in its language."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import msgspec

from trocar.review.attempts.advice import advice
from trocar.review.attempts.assessment import Assessment
from trocar.review.attempts.curve import cusum, learning_curve
from trocar.review.attempts.experts import is_proficient
from trocar.review.attempts.report import GOALS, Past, verdict
from trocar.review.attempts.store.attempts import Listed
from trocar.services.training.errors import ErrorEvent
from trocar.services.training.score import Band, ScoreRules

#: Scales of an instructor's rating: items, and the most points of each. GOALS: Vassiliou 2005; OSATS: Martin 1997.
SCALES: dict[str, tuple[tuple[str, ...], int]] = {
    "goals": (GOALS, 5),
    "osats": (
        (
            "Respect for tissue", "Time and motion", "Instrument handling", "Knowledge of instruments",
            "Use of assistants", "Flow of operation", "Knowledge of procedure",
        ),
        5,
    ),
}  # fmt: skip


class Cost(msgspec.Struct, frozen=True):
    """An error and the points that it cost, at seconds of the attempt."""

    code: str
    evidence: str
    severity: str
    begin_s: float
    end_s: float
    worst: float
    limit: float
    unit: str
    points: float


def costs(found: Assessment, rules: ScoreRules) -> list[Cost]:
    """Return what cost points, in the order of time."""
    return [_cost(event, rules) for event in found.errors]


def _cost(event: ErrorEvent, rules: ScoreRules) -> Cost:
    return Cost(
        event.code, event.evidence, event.severity, event.begin_s, event.end_s, event.worst, event.limit, event.unit,
        rules.penalty(event),
    )  # fmt: skip


def report(
    found: Assessment, rules: ScoreRules, band: Band, past: Sequence[Past], *, has_replay: bool
) -> dict[str, Any]:
    """Return the report of an attempt: the last of `past`, the trainee's attempts at the scenario."""
    told, level = verdict(found, rules, band, past)
    return {
        "attempt_id": found.attempt_id,
        "scenario": found.scenario,
        "title": found.title,
        "outcome": found.outcome,
        "reason": found.reason,
        "verdict": told,
        "level": level,
        "counts": found.counts,
        "why_not": found.why_not,
        "time_s": found.time_s,
        "time_limit_s": found.time_limit_s,
        "began_ns": found.began_ns,
        "goal_depth_m": found.goal_depth_m,
        "depth_max_m": found.depth_max_m,
        "score": found.score,
        "costs": costs(found, rules),
        "advice": advice(found, rules, band),
        "phases": found.phases,
        "series": found.series,
        "limits": found.limits,
        "bookmarks_s": found.bookmarks_s,
        "from_tick": found.from_tick,
        "source": found.source,
        "simulated_time": found.simulated_time,
        "slowest": found.slowest,
        "examined": found.examined,
        "not_judged": found.not_judged,
        "metrics": found.metrics,
        "number_of": len(past),
        "has_replay": has_replay,
        "proficient": is_proficient(found.metrics, band, rules),
    }


def curve(rows: Sequence[Listed], rules: ScoreRules, band: Band, behind: int) -> dict[str, Any]:
    """Return the learning curve over the attempts that count; `behind` reference attempts make the band."""
    counted = [row for row in rows if row.counts]
    times = [row.time_s for row in counted]
    chart = cusum([row.outcome != "success" for row in counted], rules.cusum)
    fitted = learning_curve(times)
    total = band.get("total")
    return {
        "ids": [row.id for row in counted],
        "began_ns": [row.began_ns for row in counted],
        "time_s": times,
        "score": [row.total for row in counted],
        "errors": [row.errors for row in counted],
        "fit_s": fitted.values if fitted is not None else None,
        "cusum": {"values": chart.values, "alarm": chart.alarm, "clear": chart.clear},
        "band": None if total is None else {"mean": total.mean, "deviation": total.deviation},
        "band_of": behind,
    }
