"""The report of an attempt: one HTML file that needs nothing else."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from urllib.parse import quote

import msgspec
from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template

from trocar.review.attempts.advice import advice
from trocar.review.attempts.assessment import FAULTS_ABOVE, Assessment, metric_label, metric_words
from trocar.review.attempts.curve import cusum, learning_curve
from trocar.review.attempts.experts import is_proficient
from trocar.review.attempts.figures import LEAD_S, NARROW, Chart, chart, timeline
from trocar.services.messages.page_style import page_style
from trocar.services.training.errors import ERRORS, ErrorEvent
from trocar.services.training.score import Band, ScoreRules
from trocar.services.training.situation import TISSUES

DEFAULT_PAGE = "http://localhost:8080/"
#: Named parts of a performance, which an instructor judges; GOALS, Vassiliou 2005, PMID 15972181.
GOALS = ("Depth perception", "Bimanual dexterity", "Efficiency", "Tissue handling", "Autonomy")
_LAST = 5  # earlier attempts, so that their table fits the one page


class Past(msgspec.Struct, frozen=True, kw_only=True):
    """What a report shows of an earlier attempt of the same trainee at the same scenario."""

    began_ns: int
    outcome: str
    counts: bool
    time_s: float
    total: float | None
    errors: int
    metrics: Mapping[str, float] = {}


def render(
    found: Assessment,
    rules: ScoreRules,
    *,
    trainee: str = "",
    past: Sequence[Past] = (),
    band: Band | None = None,
    page: str = DEFAULT_PAGE,
    cholangiogram: tuple[str, Sequence[str]] | None = None,
) -> str:
    """Return the report.

    Args:
        trainee: Pseudonym.
        past: All attempts of the trainee at this scenario up to this one, which comes last; empty where nobody keeps
            them.
        page: Address of the rig's page, which opens replays.
        cholangiogram: Of its end: a PNG file in base 64, empty if there is none, and sentences about it.
    """
    experts: Band = band or {}
    advised = advice(found, rules, experts)
    return _template().render(
        a=found,
        trainee=trainee,
        when=datetime.fromtimestamp(found.began_ns // 1_000_000_000, UTC).strftime("%Y-%m-%d %H:%M UTC"),
        verdict=verdict(found, rules, experts, past),
        advice=advised,
        timeline=timeline(found),
        errors=_error_rows(found, advised),
        replay=lambda event: replay_link(found, event, page),
        command=lambda event: replay_command(found, event),
        lead=lead_s,
        forces=chart(found.series.time_s, found.series.loads_n, {"limit on the duct": found.limits["tool_duct"]}),
        tissues=[(name.replace("_", " on "), _tissue(found, name)) for name in TISSUES],
        depth=_depth(found),
        paths=_json(found.series.paths_mm),
        times=_json(found.series.time_s),
        inserted=_json(found.series.inserted_mm),
        metrics=_metric_rows(found, experts, rules, past),
        learning=_learning(past),
        cusum=_cusum(past, rules),
        cholangiogram=cholangiogram,
        goals=GOALS,
        goes=len(past),
        faults_above=FAULTS_ABOVE,
        style=page_style(),
    )


@cache
def _template() -> Template:
    folder = Path(__file__).parent
    return Environment(loader=FileSystemLoader(folder), autoescape=True, undefined=StrictUndefined).get_template(
        "report.html"
    )


def _error_rows(found: Assessment, advised: Sequence[str]) -> list[tuple[ErrorEvent, str, str]]:
    """Return each error with its name and what to do about its kind, unless that was said already."""
    where = dict.fromkeys(advised, "see Practise next")
    rows = []
    for event in found.errors:
        name, what = ERRORS[event.code]
        rows.append((event, name, where.get(what, what)))
        where.setdefault(what, f"as the first {event.code}")
    return rows


def replay_link(found: Assessment, event: ErrorEvent, page: str) -> str:
    """Return the address at which the page shows the recording a little before an error."""
    return f"{page.rstrip('/')}/#replay={quote(found.source)}&at={replay_from_s(found, event):.2f}"


def replay_command(found: Assessment, event: ErrorEvent) -> str:
    """Return what shows the recording from there, as a shell takes it."""
    return f"trocar replay {shlex.quote(found.source)} --pictures --from {replay_from_s(found, event):.2f}"


def replay_from_s(found: Assessment, event: ErrorEvent) -> float:
    """Return the second of the recording at which the replay of an error begins."""
    return found.began_at_s + lead_s(event)


def lead_s(event: ErrorEvent) -> float:
    """Return the second of the attempt at which the replay of an error begins."""
    return max(0.0, event.begin_s - LEAD_S)


def _json(value: object) -> str:
    """Return what a script reads; no name in it can end the script."""
    return msgspec.json.encode(value).decode().replace("<", "\\u003c")


def verdict(found: Assessment, rules: ScoreRules, band: Band, past: Sequence[Past]) -> tuple[str, str]:
    """Return a word and a level: good, warn or bad."""
    if found.outcome == "incomplete":
        return "incomplete: the recording ends before the attempt", "warn"
    if not found.counts:
        return "does not count", "warn"
    if found.outcome != "success":
        return "not yet", "bad"
    last = [each for each in past if each.counts][-rules.attempts_in_a_row :]
    proficient = [each.outcome == "success" and is_proficient(each.metrics, band, rules) for each in last]
    if len(proficient) == rules.attempts_in_a_row and all(proficient):
        return f"proficient, {rules.attempts_in_a_row} times in a row", "good"
    if any(event.severity == "critical" for event in found.errors):
        return "reached, with a critical error", "bad"
    return "goal reached", "good"


def _tissue(found: Assessment, name: str) -> Chart:
    curve = found.series.tissues_n.get(name, [])
    return chart(found.series.time_s, {name.replace("_", " on "): curve}, {"limit": found.limits[name]}, width=NARROW)


def _depth(found: Assessment) -> Chart:
    marks = {"goal": 1e3 * found.goal_depth_m, "second marker": 1e3 * found.depth_max_m}
    return chart(found.series.time_s, {"inserted": found.series.inserted_mm}, marks)


def _metric_rows(
    found: Assessment, band: Band, rules: ScoreRules, past: Sequence[Past]
) -> list[tuple[str, str, str, str, list[str]]]:
    """Return name, unit, value, expert band (par, where no expert is known) and the last attempts of each metric."""
    earlier = [metric_words(each.metrics) for each in past[-_LAST - 1 : -1]]
    rows = []
    for name, (value, unit) in metric_words(found.metrics).items():
        expert = ""
        if name in band:
            factor = metric_words({name: 1.0})[name][0]
            mean, way = factor * band[name].mean, factor * rules.expert_deviations * band[name].deviation
            expert = f"{mean:.3g} ± {way:.2g}"
        elif name in found.par:
            expert = f"par {metric_words({name: found.par[name]})[name][0]:.3g}"
        last = [f"{each[name][0]:.3g}" if name in each else "" for each in earlier]
        rows.append((metric_label(name), unit, f"{value:.3g}", expert, last))
    return rows


def _learning(past: Sequence[Past]) -> dict[str, Chart]:
    """Return the curves of time and total over the attempts that count."""
    counted = [each for each in past if each.counts]
    if len(counted) < 2:
        return {}
    n = [float(k) for k in range(1, len(counted) + 1)]
    charts = {}
    for name, values in (
        ("Time in s", [each.time_s for each in counted]),
        ("Score", [each.total or 0.0 for each in counted]),
    ):
        curves = {"attempts": values}
        fitted = learning_curve(values)
        if fitted is not None:
            curves["power law of practice"] = fitted.values
        charts[name] = chart(n, curves, x_low=1.0, width=NARROW)
    return charts


def _cusum(past: Sequence[Past], rules: ScoreRules) -> Chart | None:
    counted = [each for each in past if each.counts]
    if len(counted) < 2:
        return None
    found = cusum([each.outcome != "success" for each in counted], rules.cusum)
    n = [float(k) for k in range(1, len(counted) + 1)]
    lines = {"unacceptable above": [found.alarm] * len(n), "acceptable below": [found.clear] * len(n)}
    return chart(n, {"CUSUM of failures": found.values, **lines}, x_low=1.0, width=NARROW)
