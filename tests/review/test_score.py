"""Totals, the experts' band, proficiency; learning curve and CUSUM against what they are made of."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from tests.refusals import assert_refused
from tests.training.streams import SCENARIO
from trocar.review.attempts.curve import cusum, learning_curve
from trocar.review.attempts.experts import band_of, is_proficient, load_band
from trocar.services.runtime.errors import ConfigError
from trocar.services.training.errors import ErrorEvent
from trocar.services.training.score import CusumRates, load_rules, score_of

RULES = load_rules()


def error(severity: str, code: str = "E1") -> ErrorEvent:
    return ErrorEvent(
        code=code, evidence="", severity=severity, phase="P4", begin_s=1.0, end_s=2.0, worst=1.0, limit=0.5, unit="N"  # type: ignore[arg-type]
    )  # fmt: skip


def test_the_total_is_time_saved_less_penalties() -> None:
    errors = [error("critical"), error("consequential"), error("coaching")]
    score = score_of(SCENARIO, RULES, "success", 100.0, errors, {})
    assert score is not None
    assert (score.time_saved_s, score.penalties_s, score.total) == (200.0, 82.0, 118.0)
    assert score.percent is None


def test_a_total_is_never_negative_and_zero_at_time_out() -> None:
    many = [error("critical")] * 10
    for outcome, time_s, errors in (("success", 100.0, many), ("success", 300.0, []), ("failure", 10.0, [])):
        score = score_of(SCENARIO, RULES, outcome, time_s, errors, {})
        assert score is not None
        assert score.total == 0.0
    assert score_of(SCENARIO, RULES, "incomplete", 10.0, [], {}) is None


def test_scores_are_normalised_by_the_experts_then_the_rules_then_the_par() -> None:
    from dataclasses import replace

    with_par = replace(SCENARIO, par={"time_s": 50.0})
    known = replace(RULES, expert_total=200.0)
    band = band_of([{"total": 150.0}, {"total": 170.0}])
    percents = [
        score_of(with_par, rules, "success", 100.0, [], experts).percent  # type: ignore[union-attr]
        for rules, experts in ((RULES, {}), (known, {}), (known, band))
    ]
    assert percents == pytest.approx([80.0, 100.0, 125.0])


def test_the_band_is_two_deviations_wide() -> None:
    values = np.random.default_rng(5).normal(30.0, 4.0, 40)
    band = band_of([{"time_s": value, "errors": 1.0} for value in values])
    assert band["time_s"].mean == pytest.approx(values.mean())
    assert band["time_s"].deviation == pytest.approx(values.std(ddof=1))
    limit = values.mean() + 2.0 * values.std(ddof=1)
    assert is_proficient({"time_s": limit - 0.01, "errors": 1.0}, band, RULES)
    assert not is_proficient({"time_s": limit + 0.01, "errors": 1.0}, band, RULES)
    assert not is_proficient({"time_s": 20.0, "errors": 2.0}, band, RULES)
    assert is_proficient({"time_s": 1.0, "errors": 0.0}, {}, RULES) is None


def test_experts_are_the_successes_at_the_scenario_that_count(tmp_path: Path) -> None:
    path = tmp_path / "experts.json"
    told = [
        {"scenario": "basic", "outcome": outcome, "counts": counts, "metrics": {"time_s": time_s}}
        for outcome, counts, time_s in (("success", True, 20.0), ("failure", True, 99.0), ("success", False, 98.0))
    ]
    path.write_text(json.dumps({"attempts": told}))
    assert load_band(path, "basic")["time_s"].mean == 20.0
    with pytest.raises(ConfigError, match=r"experts.json: holds no attempt at 'narrow'"):
        load_band(path, "narrow")
    path.write_text("[1]")
    with pytest.raises(ConfigError, match=r"experts.json: is no file of attempts"):
        load_band(path, "basic")


@pytest.mark.parametrize(
    ("rules", "sentence"),
    [
        ("penalty_s: {fatal: 1.0}", r"penalty_s.fatal"),
        *(
            (f"penalty_s: {{critical: 1.0}}\ncusum: {{{rates}}}", r"cusum: 0 < acceptable < unacceptable < 1 must hold")
            for rates in (
                "acceptable: 0.5, unacceptable: 0.2",
                "acceptable: 0.2, unacceptable: 0.2",
                "acceptable: 0.0, unacceptable: 0.2",
                "acceptable: 0.2, unacceptable: 1.0",
            )
        ),
        *(
            (f"penalty_s: {{critical: 1.0}}\ncusum: {{{rates}}}", r"cusum: .* must")
            for rates in ("false_alarm: 0.0", "false_alarm: 0.5", "missed_alarm: 0.0", "missed_alarm: 0.5")
        ),
    ],
)
def test_a_mistake_in_rules_is_one_sentence(tmp_path: Path, rules: str, sentence: str) -> None:
    assert_refused(load_rules, tmp_path / "mine.yaml", rules, f"mine.yaml: {sentence}")


@pytest.mark.parametrize(
    "rates",
    [
        "acceptable: 0.001, unacceptable: 0.999",
        "false_alarm: 0.001, missed_alarm: 0.499",
        "false_alarm: 0.499, missed_alarm: 0.001",
    ],
)
def test_rates_of_a_chart_may_be_as_far_as_their_bounds(tmp_path: Path, rates: str) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(f"penalty_s: {{critical: 1.0}}\ncusum: {{{rates}}}\n")
    assert load_rules(path).cusum != CusumRates()


def test_what_was_scored_stays_as_it_is() -> None:
    score = score_of(SCENARIO, RULES, "success", 100.0, [], {})
    assert score is not None
    for holder, name in ((score, "total"), (RULES, "attempts_in_a_row"), (RULES.cusum, "acceptable")):
        with pytest.raises(AttributeError):
            setattr(holder, name, 0)


RATES = CusumRates(acceptable=0.1, unacceptable=0.3, false_alarm=0.05, missed_alarm=0.1)


def test_cusum_is_the_log_likelihood_ratio_of_the_two_rates() -> None:
    failed = np.random.default_rng(6).random(60) < 0.2
    chart = cusum(failed.tolist(), RATES)
    p, q = RATES.acceptable, RATES.unacceptable
    ratio = np.cumsum(np.where(failed, math.log(q / p), math.log((1 - q) / (1 - p))))
    unit = math.log(q / p) - math.log((1 - q) / (1 - p))
    np.testing.assert_allclose(chart.values, ratio / unit, atol=1e-12)
    assert chart.alarm * unit == pytest.approx(math.log(0.9 / 0.05))
    assert chart.clear * unit == pytest.approx(math.log(0.1 / 0.95))


@pytest.mark.parametrize(("rate", "crosses_alarm"), [(RATES.acceptable, False), (RATES.unacceptable, True)])
def test_cusum_judges_rates_as_wrongly_as_it_is_told(rate: float, crosses_alarm: bool) -> None:
    """Wald: with boundaries set so, an alarm of an acceptable rate has at most 5 %, a missed one 10 % or so."""
    chance, wrong, runs = np.random.default_rng(7), 0, 400
    for _ in range(runs):
        values = np.array(cusum((chance.random(400) < rate).tolist(), RATES).values)
        chart = cusum([], RATES)
        above, below = np.flatnonzero(values > chart.alarm), np.flatnonzero(values < chart.clear)
        first_is_alarm = above.size > 0 and (below.size == 0 or above[0] < below[0])
        wrong += first_is_alarm != crosses_alarm
    assert wrong / runs <= (0.10 if crosses_alarm else 0.05) * 1.3


def test_the_learning_curve_of_a_power_law_is_that_law() -> None:
    n = np.arange(1.0, 31.0)
    found = learning_curve((40.0 + 60.0 * n**-0.7).tolist())
    assert found is not None
    assert (found.plateau, found.gain, found.rate) == pytest.approx((40.0, 60.0, 0.7), rel=1e-3)
    assert learning_curve([50.0] * 10) is None
    assert learning_curve([50.0, 40.0, 30.0]) is None
