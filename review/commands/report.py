"""``trocar report``: one attempt as one HTML file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from trocar.review.attempts.assessment import Assessment
from trocar.review.attempts.experts import load_band
from trocar.review.attempts.recorded import assess_file
from trocar.review.attempts.report import Past, render
from trocar.services.cli import targets
from trocar.services.runtime.errors import ConfigError, UserError
from trocar.services.training.scenario import asks_for_cholangiogram
from trocar.services.training.score import load_rules


@dataclass(frozen=True, slots=True)
class ReportRequest:
    """What the command line asks for; `what` is a recording, or the number of an attempt that was kept.

    `attempt` is which of the recording, from 1, negative from the last; 0: each of them.
    """

    what: str
    out: Path | None
    attempt: int
    scenario: str | None
    rules: str
    experts: Path | None
    database: str | None
    page: str


def run_report(request: ReportRequest) -> None:
    """Write the report, or one of each attempt in a recording, and say where it is.

    Raises RecordingError or ConfigError or StoreError: one sentence, if something of what is named cannot be used.
    """
    out = request.out or Path(f"report-{Path(request.what).stem}.html")
    targets.look_at_file("--out", out)
    if request.what.isdecimal():
        found, recording, trainee, past = _kept(request)
        _write(out, found, recording, request, trainee, past)
        return
    chosen = _of_file(request)
    for number, each in chosen.items():
        to = out if len(chosen) == 1 else out.with_stem(f"{out.stem}-{number}")
        _write(to, each, Path(request.what), request)


def _write(
    out: Path,
    found: Assessment,
    recording: Path,
    request: ReportRequest,
    trainee: str = "",
    past: Sequence[Past] = (),
) -> None:
    rules = load_rules(request.rules)
    band = load_band(request.experts, found.scenario) if request.experts else {}
    still = _cholangiogram(found, recording)
    text = render(found, rules, trainee=trainee, past=past, band=band, page=request.page, cholangiogram=still)
    targets.write_text("--out", out, text)
    print(out)


def _cholangiogram(found: Assessment, recording: Path) -> tuple[str, list[str]] | None:
    """Return the picture of an attempt's end and sentences about it, or why there is none; None if nobody asks."""
    if not asks_for_cholangiogram(found.scenario):
        return None
    from trocar.review.export.still import Moment, still_of

    tick, time_ns = found.last_moment
    try:
        still = still_of(recording, Moment(tick=tick, time_ns=time_ns))
    except UserError as error:
        return "", [f"It cannot be drawn: {error}."]
    return still.image, still.words


def _kept(request: ReportRequest) -> tuple[Assessment, Path, str, list[Past]]:
    from trocar.review.commands.attempts import reading

    with reading(request.database) as store:
        found, trainee = store.assessment(int(request.what))
        return found, store.recording(int(request.what)), trainee, store.past(trainee, found.scenario, found.began_ns)


def _of_file(request: ReportRequest) -> dict[int, Assessment]:
    """Return the attempts that are asked for by their number in the recording."""
    rules = load_rules(request.rules)
    every = assess_file(Path(request.what), rules, request.scenario, request.experts)
    if not every:
        raise ConfigError(f"{request.what}: nobody makes an attempt in it")
    found = dict(enumerate(every, 1))
    if request.attempt == 0:
        return found
    number = request.attempt if request.attempt > 0 else len(every) + 1 + request.attempt
    if number not in found:
        raise ConfigError(f"--attempt {request.attempt}: the recording has attempts 1 to {len(every)}")
    return {number: found[number]}
