"""The settings without a rig: the page, who may use it, and a rig file with an error."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from tests import chromium
from tests.chromium import Chromium
from tests.patience import PATIENCE_S
from tests.review.class_of_pages import served
from trocar.review.journal import ActJournal
from trocar.review.school.settings_routes import EditableSettings
from trocar.review.settings.files import ConfigurationFiles
from trocar.review.settings.host import Host
from trocar.review.settings.page import build_app
from trocar.services.runtime.config.config import config_directory
from trocar.services.runtime.errors import ConfigError
from trocar.services.supervisor.page.page_place import DIST

TOKEN = "of the settings 7"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A configuration folder of which one rig file has an error."""
    made = tmp_path / "configs"
    for kind in ("rigs", "scenes", "devices"):
        shutil.copytree(config_directory() / kind, made / kind)
    (made / "rigs" / "mouse.yaml").write_text("gatewy: {}\n")
    return made


@pytest.fixture
def address(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    monkeypatch.setenv("TROCAR_CONFIG_DIR", str(folder))
    host = Host(None, ("mouse", ()), "default", is_running=False)
    app = build_app(EditableSettings(ConfigurationFiles(folder), host), ActJournal(tmp_path / "acts"), TOKEN)
    with served(app) as [address]:
        yield address


@pytest.mark.parametrize("token", ["", "guessed", "of the settings 8"])
def test_nobody_without_the_token_sees_or_changes_a_file(address: str, token: str) -> None:
    headers = {"X-Trocar-Token": token, "X-Trocar-Role": "instructor"}
    for path in ("settings", "settings/files/rig/mouse", "settings/logs"):
        assert httpx.get(f"{address}/school/{path}", headers=headers).status_code == 403
    assert httpx.post(f"{address}/school/settings/save", json={}, headers=headers).status_code == 403


def test_what_needs_the_rig_file_names_it(address: str) -> None:
    for path in ("settings/logs", "settings/disk"):
        said = httpx.get(f"{address}/school/{path}", headers={"X-Trocar-Token": TOKEN}, timeout=PATIENCE_S)
        assert said.status_code == 409
        assert "'mouse' cannot be read" in said.json()["error"]


def test_a_page_that_is_not_built_is_told(tmp_path: Path) -> None:
    host = Host(None, ("mouse", ()), "default", is_running=False)
    with pytest.raises(ConfigError, match="is not built"):
        build_app(
            EditableSettings(ConfigurationFiles(tmp_path), host),
            ActJournal(tmp_path / "acts"),
            TOKEN,
            tmp_path / "none",
        )


def test_a_port_that_is_taken_is_told_in_a_sentence() -> None:
    with served(lambda *_: None) as [address]:  # type: ignore[arg-type, return-value]
        port = address.rsplit(":", 1)[1]
        command = [sys.executable, "-m", "trocar.services.cli.app", "settings", "--port", port]
        ran = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ran.returncode != 0
    assert re.search(rf"cannot listen on 127\.0\.0\.1:{port}.*--port N", ran.stderr.replace("\n", " "))


@pytest.mark.skipif(chromium.find() is None, reason="no Chromium on this machine")
@pytest.mark.skipif(not (DIST / "index.html").is_file(), reason="the page is not built")
def test_a_rig_file_with_an_error_is_mended_at_the_page(address: str, folder: Path, tmp_path: Path) -> None:
    with Chromium(tmp_path / "profile") as browser:

        def until(expression: str, what: str) -> None:
            browser.until(lambda: browser.evaluate(expression), PATIENCE_S, what)

        browser.open(f"{address}/#token={TOKEN}")
        until("/gatewy/.test(document.querySelector('#file-said')?.textContent ?? '')", "the error is told")
        assert not browser.evaluate("Boolean(document.querySelector('#file-start'))"), "there is no rig to start anew"
        sound = (config_directory_of_package() / "rigs" / "mouse.yaml").read_text()
        browser.evaluate(f"const box = document.querySelector('#file-text'); box.value = {sound!r}; box.oninput()")
        until("/Sound/.test(document.querySelector('#file-said').textContent)", "it is sound")
        browser.evaluate("document.querySelector('#file-save').click()")
        until("/Saved/.test(document.querySelector('#file-said').textContent)", "it is saved")
        browser.screenshot(tmp_path / "settings.png")
    assert (folder / "rigs" / "mouse.yaml").read_text() == sound


def config_directory_of_package() -> Path:
    """Return the shipped folder, whatever the environment names."""
    return Path(__file__).parents[2] / "configs"
