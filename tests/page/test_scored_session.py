"""What is left of the newcomer's session: its recording is scored, each attempt has its report."""

from __future__ import annotations

import json
import signal
from pathlib import Path

import pytest
from typer.testing import CliRunner

from tests import chromium
from tests.page.conftest import Made
from tests.page.newcomer import Mouse
from tests.patience import PATIENCE_S
from trocar.protocol.bodies import Attempt
from trocar.services.cli.app import add_installed_verbs, app

pytestmark = [
    pytest.mark.rig,
    pytest.mark.timeout(600),
    pytest.mark.skipif(chromium.find() is None, reason="no Chromium on this machine"),
]


def run(*arguments: str) -> str:
    add_installed_verbs()
    result = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.stdout


@pytest.fixture(scope="module")
def session(mouse: Mouse, first: Made) -> tuple[Path, Attempt]:
    """End the rig; return its first recording, and an attempt that was done in it as it was told."""
    mouse.rig.process.send_signal(signal.SIGINT)
    assert mouse.rig.process.wait(PATIENCE_S) == 0
    return min((mouse.rig.directory / "recordings").glob("*.mcap")), first.told


def test_each_attempt_of_the_recording_is_scored_and_kept(session: tuple[Path, Attempt], tmp_path: Path) -> None:
    path, told = session
    kept = ("--trainee", "heron-17", "--database", str(tmp_path / "a.sqlite"))
    every = json.loads(run("score", str(path), *kept, "--json"))["attempts"]
    (scored,) = (each for each in every if each["attempt_id"] == told.attempt_id)
    assert (scored["outcome"], scored["scenario"]) == ("success", "basic")
    assert scored["time_s"] == told.time_s
    assert scored["score"]["total"] == pytest.approx(300.0 - told.time_s - scored["score"]["penalties_s"])
    assert told.score >= 0.0, "the page told a score, too"
    assert scored["metrics"]["deepest_m"] >= 0.01
    listed = json.loads(run("attempts", "list", "--database", str(tmp_path / "a.sqlite"), "--json"))["attempts"]
    assert next(each["time_s"] for each in listed if each["outcome"] == "success") == told.time_s
    assert json.loads(run("score", str(path), "--json"))["attempts"] == every, "again, and whether it is kept or not"


def test_each_has_a_report_that_a_browser_opens(session: tuple[Path, Attempt], mouse: Mouse, tmp_path: Path) -> None:
    path, told = session
    out, browser = tmp_path / "report.html", mouse.browser
    written = run("report", str(path), "--out", str(out)).split()
    assert written == [str(tmp_path / f"report-{k}.html") for k in range(1, len(written) + 1)]
    assert len(written) >= 2
    assert run("report", str(path), "--attempt", "2", "--out", str(out)).split() == [str(out)]
    assert out.read_text() == Path(written[1]).read_text()
    page = next(Path(each) for each in written if told.attempt_id in Path(each).read_text()).as_uri()
    browser.open(page)
    there = f"document.readyState === 'complete' && location.href === {page!r}"
    browser.until(lambda: browser.evaluate(there), PATIENCE_S, "the report is there")
    assert f"{told.time_s:.1f} s" in browser.text(".tiles")
    assert browser.evaluate("document.querySelectorAll('#timeline .phase').length") >= 3
    assert browser.evaluate("times.length > 20 && names.length === 3")
