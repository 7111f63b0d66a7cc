"""``trocar report``: one attempt as one HTML file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from services.atomic_file import atomic_file
from services.runtime.errors import ConfigError
from services.training.assessment import Assessment
from services.training.recorded import assess_file
from services.training.report import Past, render
from services.training.score import load_band, load_rules


@dataclass(frozen=True, slots=True)
class Request:
    """What the command line asks for; `what` is a recording, or the number of an attempt that was kept."""

    what: str
    out: Path | None
    attempt: int
    scenario: str | None
    rules: str
    experts: Path | None
    database: str | None
    page: str


def run_report(request: Request) -> None:
    """Write the report and say where it is.

    Raises
    ------
    RecordingError, ConfigError, StoreError
        one sentence, if something of what is named cannot be used.
    """
    found, trainee, past = _kept(request) if request.what.isdecimal() else (_of_file(request), "", [])
    rules = load_rules(request.rules)
    band = load_band(request.experts, found.scenario) if request.experts else {}
    out = request.out or Path(f"report-{Path(request.what).stem}.html")
    text = render(found, rules, trainee=trainee, past=past, band=band, page=request.page)
    with atomic_file(out) as half:
        half.write_text(text, encoding="utf-8")
    print(out)


def _kept(request: Request) -> tuple[Assessment, str, list[Past]]:
    from services.training.store.attempts import Store

    with Store(request.database) as store:
        found, trainee = store.assessment(int(request.what))
        return found, trainee, store.past(trainee, found.scenario, found.began_ns)


def _of_file(request: Request) -> Assessment:
    rules = load_rules(request.rules)
    found = assess_file(Path(request.what), rules, request.scenario, request.experts)
    if not found:
        raise ConfigError(f"{request.what}: nobody makes an attempt in it")
    if not 1 <= request.attempt <= len(found) and request.attempt != -1:
        raise ConfigError(f"--attempt {request.attempt}: the recording has attempts 1 to {len(found)}")
    return found[request.attempt - (request.attempt > 0)]
