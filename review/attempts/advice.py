"""Advises in a sentence what to practise next: the costliest errors first, then what is farthest from the experts."""

from __future__ import annotations

from trocar.review.attempts.assessment import Assessment, metric_words
from trocar.services.training.errors import ERRORS
from trocar.services.training.scenario import ErrorCode
from trocar.services.training.score import Band, ScoreRules

_MOST = 3  # assumption: nobody works on more at once
METRICS = {
    "time_s": "the time",
    "path_m": "the path of {}",
    "regrasps": "the regrasps",
    "retries": "the new approaches to the mouth",
    "peak_n": "the peak force of {}",
    "load_n_s": "the load of {} on the tissue",
    "idle_share": "the idle share of {}",
}
"""Metrics that a trainee can practise against, by the end of their name, with whose they are; more of each is worse."""


def advice(found: Assessment, rules: ScoreRules, band: Band) -> list[str]:
    """Return up to three sentences, the most important first; one at least."""
    costs: dict[ErrorCode, float] = dict.fromkeys(ERRORS, 0.0)
    for event in found.errors:
        costs[event.code] += rules.penalty(event)
    codes = sorted(costs, key=lambda code: -costs[code])
    said = [ERRORS[code][1] for code in codes if costs[code] > 0.0]
    said += _against_experts(found, band, rules.expert_deviations)
    if not said and found.outcome == "success":
        said = ["Nothing stood out: do it again to be sure, then take a harder scenario."]
    elif not said:
        said = [f"Bring the catheter to {1e3 * found.goal_depth_m:.0f} mm within {found.time_limit_s:.0f} s."]
    return list(dict.fromkeys(said))[:_MOST]


def _against_experts(found: Assessment, band: Band, deviations: float) -> list[str]:
    away: list[tuple[float, str]] = []
    words = metric_words(found.metrics)
    for name, value in found.metrics.items():
        owner, _, end = name.rpartition(".")
        if end not in METRICS or name not in band:
            continue
        mean, most = band[name].mean, band[name].mean + deviations * band[name].deviation
        if value > most and mean > 0.0:
            number, unit = words[name]
            what = METRICS[end].format(owner.replace("_", " on "))
            shown, limit = f"{number:.3g} {unit}".rstrip(), number * most / value
            away.append((value / mean, f"Reduce {what}: {shown}, experts keep below {limit:.3g}."))
    return [sentence for _, sentence in sorted(away, reverse=True)]
