"""A session from a new profile by mouse alone, on a real rig: name, attempts, report, replay, curve, next task.

``python -m tests.page.school_session`` holds ten, each with its own rig and browser, and writes what came of
them.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from benchmarks.report import describe_run
from tests.chromium import Chromium
from tests.page.newcomer import UP, Course, Mouse, attempt
from tests.patience import PATIENCE_S
from tests.rig.conftest import running_rig

ATTEMPTS, SESSIONS = 3, 10
_READY = "document.getElementById('depth-value').textContent === '0.0 mm'"
_ATTEMPT_S = 600.0
RESULT = Path(__file__).parents[2] / "benchmarks" / "results" / "school-sessions.md"


@contextmanager
def bench(directory: Path) -> Iterator[Mouse]:
    """Start a rig as anybody starts one, and a browser with a new profile."""
    overrides = ["training.scenario=basic"]
    with (
        running_rig(directory, "default", overrides, ("training.attempt",), rig="mouse", program=UP) as rig,
        Chromium(directory / "profile", size=(1000, 640)) as browser,
    ):
        yield Mouse(rig, browser)


def session(mouse: Mouse) -> list[Course]:
    """Take a name, make the attempts with a look at each report and replay, and find them all in the list."""
    mouse.arrive()
    browser, courses = mouse.browser, []
    trainee = browser.text("#who")
    for _ in range(ATTEMPTS):
        courses.append(attempt(mouse, _ATTEMPT_S))
        print(courses[-1], flush=True)
        _read_report(mouse)
        mouse.press("#report-next")
        browser.until(lambda: browser.evaluate(_READY), PATIENCE_S, "the next attempt is ready")
        if mouse.sees("#hands.taken"):
            mouse.press("#take-hands")
    mouse.press("#my-attempts")
    rows = "document.querySelectorAll('table.attempts tbody tr').length"
    browser.until(lambda: browser.evaluate(rows) == ATTEMPTS, PATIENCE_S, f"all attempts of {trainee} are listed")
    return courses


def _read_report(mouse: Mouse) -> None:
    """Read the report that opens by itself, with its curve, and jump to an error in the replay if there is one."""
    browser = mouse.browser
    browser.until(lambda: mouse.sees("#sheet-close"), PATIENCE_S, "the report opens")
    browser.until(lambda: browser.evaluate("Boolean(trocar.player?.screens?.length)"), PATIENCE_S, "the replay")
    shown = browser.text("#sheet-body")
    assert "points" in shown
    assert "Your curve" in shown
    if mouse.sees(".jump"):
        mouse.press(".jump")
        assert browser.evaluate("trocar.player.second") >= 0.0


def main() -> None:
    """Hold the sessions, and write what came of them beside the results of the benchmarks."""
    rows, good, counted = [], 0, 0
    for number in range(1, SESSIONS + 1):
        with tempfile.TemporaryDirectory() as made, bench(Path(made)) as mouse:
            courses = session(mouse)
        good += sum(each.headline.startswith("Well done") for each in courses)
        counted += sum(not each.not_counted for each in courses)
        rows += [
            f"| {number} | {each.headline} | {each.since_page_s:.0f} | {each.score} | {each.not_counted or 'counts'} |"
            for each in courses
        ]
    about = "\n".join(f"- {key}: {value}" for key, value in describe_run().items())
    text = _TEXT.format(
        rows="\n".join(rows), good=good, counted=counted, made=SESSIONS * ATTEMPTS, sessions=SESSIONS,
        attempts=ATTEMPTS, cores=os.cpu_count(), about=about,
    )  # fmt: skip
    RESULT.write_text(text, encoding="utf-8")


_TEXT = """# Sessions of a new trainee by mouse

Written by `python -m tests.page.school_session`: {sessions} times a scripted browser with a new profile takes a
name, makes {attempts} attempts at `basic` by mouse events alone, following what the page says, reads each report
and its curve, looks at the replay, and goes on to the next task. {good} of {made} attempts end in "Well done", and
{counted} of {made} count. The browser draws on the processor, on the same {cores} cores as the rig.

{about}

| session | the page says | since the page, s | score | beside it |
|---|---|---|---|---|
{rows}
"""


if __name__ == "__main__":
    main()
