"""``trocar score``: the attempts in a recording, judged and perhaps kept."""

from __future__ import annotations

from pathlib import Path

import msgspec
from rich.console import Console
from rich.markup import escape

from trocar.review.attempts.assessment import Assessment
from trocar.review.attempts.recorded import assess_file
from trocar.review.commands.keep import Kept, keep
from trocar.services.training.errors import ERRORS
from trocar.services.training.score import load_rules


def run_score(
    file: Path,
    scenario: str | None,
    rules: str,
    experts: Path | None,
    trainee: str | None,
    database: str | None,
    as_json: bool,
) -> None:
    """Judge a recording, and keep its attempts where a trainee is named.

    Raises RecordingError or ConfigError or StoreError: one sentence, if something of what is named cannot be used.
    """
    found = assess_file(file, load_rules(rules), scenario, experts)
    kept = Kept() if trainee is None else keep(found, trainee, database, file)
    if as_json:
        print(msgspec.json.format(msgspec.json.encode({"attempts": found, "numbers": kept.numbers}), indent=1).decode())
    else:
        _print_all(file, found, kept)
    if kept.refused is not None:
        raise kept.refused


def _print_all(file: Path, found: list[Assessment], kept: Kept) -> None:
    console = Console(highlight=False, soft_wrap=True)
    if not found:
        console.print(f"{escape(str(file))}: nobody makes an attempt in it")
    for each in found:
        _print(each, console)
    for number, (before, now) in kept.moved.items():
        console.print(f"attempt {number} was kept as {escape(before)}'s; it is {escape(now)}'s now")
    if kept.numbers:
        said = ", ".join(map(str, kept.numbers))
        console.print(f"kept as {said}: `trocar report {kept.numbers[-1]}` shows the last")


def _print(found: Assessment, console: Console) -> None:
    score = f"{found.score.total:.0f}" if found.score else "none"
    percent = f", {found.score.percent:.0f} % of an expert's" if found.score and found.score.percent is not None else ""
    console.print(
        f"[bold]{escape(found.title)}[/]: {found.outcome} after {found.time_s:.1f} s, score {score}{percent}, "
        f"deepest {1e3 * found.metrics['deepest_m']:.1f} mm"
    )
    for why in found.why_not:
        console.print(f"  does not count: {escape(why)}")
    for event in found.errors:
        name = ERRORS[event.code][0]
        console.print(
            f"  {event.begin_s:7.2f} s  {event.code:<3} {name} ({event.severity}): {event.evidence} "
            f"{event.worst:.3g} {event.unit}, limit {event.limit:.3g}"
        )
