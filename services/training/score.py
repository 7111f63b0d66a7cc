"""The score of an attempt in the form of MISTELS, relative to a band of experts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import msgspec

from trocar.services.runtime.config import config
from trocar.services.runtime.errors import ConfigError
from trocar.services.training.errors import ErrorEvent, Severity
from trocar.services.training.scenario import STRICT, ErrorCode, Scenario


@dataclass(frozen=True, slots=True, kw_only=True)
class CusumRates:
    """Rates for `trocar.review.attempts.curve.cusum`."""

    __pydantic_config__ = STRICT

    acceptable: float = 0.1
    unacceptable: float = 0.3
    false_alarm: float = 0.1
    missed_alarm: float = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class ScoreRules:
    """A file of configs/scores, which documents the keys."""

    __pydantic_config__ = STRICT

    penalty_s: Mapping[Severity, float]
    penalty_of_s: Mapping[ErrorCode, float] = field(default_factory=dict)
    expert_total: float | None = None
    expert_deviations: float = 2.0
    attempts_in_a_row: int = 2
    cusum: CusumRates = CusumRates()

    def penalty(self, event: ErrorEvent) -> float:
        """Return the penalty of an error, in s."""
        return self.penalty_of_s.get(event.code, self.penalty_s.get(event.severity, 0.0))


def load_rules(name: str | Path = "mistels") -> ScoreRules:
    """Return the rules of a file, or of a bare name in configs/scores.

    Raises ConfigError: one sentence that names the file and the key.
    """
    path = config.find("score", name)
    rules = config.build(ScoreRules, config.read_yaml(path), str(path))
    rates = rules.cusum
    if not 0.0 < rates.acceptable < rates.unacceptable < 1.0:
        raise ConfigError(f"{path}: cusum: 0 < acceptable < unacceptable < 1 must hold")
    if not (0.0 < rates.false_alarm < 0.5 and 0.0 < rates.missed_alarm < 0.5):
        raise ConfigError(f"{path}: cusum: false_alarm and missed_alarm must be between 0 and 0.5")
    return rules


class Score(msgspec.Struct, frozen=True, kw_only=True):
    """Total in s, at least 0, and in percent of an expert's, None if that is unknown."""

    total: float
    time_saved_s: float
    penalties_s: float
    percent: float | None = None


class Range(msgspec.Struct, frozen=True):
    """Mean and standard deviation of a metric over reference attempts."""

    mean: float
    deviation: float


Band = Mapping[str, Range]


def score_of(
    scenario: Scenario, rules: ScoreRules, outcome: str, time_s: float, errors: Sequence[ErrorEvent], band: Band
) -> Score | None:
    """Return the score of a completed attempt, None otherwise."""
    if outcome not in ("success", "failure"):
        return None
    cut_off_s = scenario.goal.time_limit_s
    saved_s = max(0.0, cut_off_s - time_s)
    penalties_s = sum(map(rules.penalty, errors), 0.0)
    total = max(0.0, saved_s - penalties_s) if outcome == "success" else 0.0
    expert = _expert_total(scenario, rules, band)
    percent = 100.0 * total / expert if expert else None
    return Score(total=total, time_saved_s=saved_s, penalties_s=penalties_s, percent=percent)


def _expert_total(scenario: Scenario, rules: ScoreRules, band: Band) -> float | None:
    if "total" in band:
        return band["total"].mean
    if rules.expert_total is not None:
        return rules.expert_total
    par_s = scenario.par.get("time_s")
    return None if par_s is None else max(0.0, scenario.goal.time_limit_s - par_s)
