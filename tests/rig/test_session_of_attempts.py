"""A session on a running rig: hands insert again and again, the recording is scored, each attempt has its report."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from protocol.bodies import Attempt
from services.cli.app import add_installed_verbs, app
from services.cli.arm import ask_at
from services.runtime.rig import Transport
from services.supervisor.page_place import page_file
from tests import chromium
from tests.obeyed import until_obeyed
from tests.patience import PATIENCE_S
from tests.rig.conftest import running_rig

pytestmark = [pytest.mark.rig, pytest.mark.timeout(600)]

LASTS_S = 300.0  # an attempt takes four seconds
#: Of the hands, which are as good as slower ones and wait for less.
PACE = 0.5


def run(*arguments: str) -> str:
    add_installed_verbs()
    result = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.stdout


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Attempt]]:
    """Return a recording, and the attempts that were done in it as they were told."""
    folder = tmp_path_factory.mktemp("session")
    told: dict[str, Attempt] = {}
    hands = [f"gateway.instruments.{i}.{device}.settings.pace={PACE}" for i in (0, 1) for device in ("arm", "grasp")]
    with running_rig(folder, "default", ["training.again_after_s=1", *hands], topics=("training.attempt",)) as rig:

        def done() -> list[Attempt]:
            told.update((frame.body.attempt_id, frame.body) for frame in rig.observer.bus.drain("training.attempt"))
            return [each for each in told.values() if each.state == "done"]

        rig.observer.until(lambda: rig.observer.is_up, PATIENCE_S, "hands are engaged")
        # Scripted hands wait for nobody: on a busy machine they are in before the training process follows them.
        rig.observer.until(lambda: bool(done() or told), LASTS_S, "somebody follows the attempt")
        page = json.loads(page_file(Transport(directory=folder / "bus")).read_text())
        until_obeyed(lambda: ask_at(page["address"], page["token"], "attempt", {"what": "new"}))
        told.clear()
        rig.observer.until(lambda: bool(done()), LASTS_S, "an attempt is done")
        ended = done()
        rig.observer.until(lambda: bool(done()) and len(told) > 1, LASTS_S, "and another has begun")
    (path,) = (folder / "recordings").glob("*.mcap")
    return path, ended[:1]


def test_each_attempt_of_the_recording_is_scored_and_kept(session: tuple[Path, list[Attempt]], tmp_path: Path) -> None:
    path, told = session
    kept = ("--trainee", "heron-17", "--database", str(tmp_path / "a.sqlite"))
    every = json.loads(run("score", str(path), *kept, "--json"))["attempts"]
    ids = [each.attempt_id for each in told]
    scored = [each for each in every if each["attempt_id"] in ids]
    assert [each["attempt_id"] for each in scored] == ids
    for each, said in zip(scored, told, strict=False):
        assert (each["outcome"], each["scenario"]) == ("success", "basic")
        assert each["time_s"] == said.time_s
        assert each["score"]["total"] == pytest.approx(300.0 - said.time_s - each["score"]["penalties_s"])
        assert said.score >= 0.0, "the page told a score, too"
        assert each["metrics"]["deepest_m"] >= 0.01
    listed = json.loads(run("attempts", "list", "--database", str(tmp_path / "a.sqlite"), "--json"))["attempts"]
    done = [each for each in listed if each["outcome"] == "success"]
    assert [each["time_s"] for each in done[:2]] == [each.time_s for each in told]
    assert json.loads(run("score", str(path), "--json"))["attempts"] == every, "again, and whether it is kept or not"


@pytest.mark.skipif(chromium.find() is None, reason="no Chromium")
def test_each_has_a_report_that_a_browser_opens(session: tuple[Path, list[Attempt]], tmp_path: Path) -> None:
    path, told = session
    out = tmp_path / "report.html"
    written = run("report", str(path), "--out", str(out)).split()
    assert written == [str(tmp_path / f"report-{k}.html") for k in range(1, len(written) + 1)]
    assert len(written) >= 2
    assert run("report", str(path), "--attempt", "2", "--out", str(out)).split() == [str(out)]
    assert out.read_text() == Path(written[1]).read_text()
    written = [next(each for each in written if said.attempt_id in Path(each).read_text()) for said in told]
    with chromium.Chromium(tmp_path / "profile") as browser:
        for file, said in zip(written, told, strict=False):
            browser.open(Path(file).as_uri())
            browser.until(
                lambda: browser.evaluate("document.readyState") == "complete", PATIENCE_S, "the report is there"
            )
            assert f"{said.time_s:.1f} s" in browser.text(".tiles")
            assert browser.evaluate("document.querySelectorAll('#timeline .phase').length") >= 3
            assert browser.evaluate("times.length > 20 && names.length === 3")
