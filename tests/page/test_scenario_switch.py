"""An instructor begins another scenario from the page: address and token stay, and what cannot be run is refused."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from services.runtime.rig import Transport
from services.supervisor.page_place import page_file
from tests import chromium
from tests.chromium import PATIENCE_S, Chromium
from tests.page.orders import order
from tests.rig.conftest import START_S, Rig, running_rig

pytestmark = [
    pytest.mark.rig,
    pytest.mark.timeout(900),
    pytest.mark.skipif(chromium.find() is None, reason="no Chromium on this machine"),
]
#: Keeps all that the page says to the instructor, over its reload: no look from outside is as quick as that may be.
_HEAR = """
{
    const said = document.getElementById("instructor-said");
    const before = () => sessionStorage.getItem("heard") ?? "";
    const keep = () => sessionStorage.setItem("heard", `${before()}${said.textContent}\\n`);
    new MutationObserver(keep).observe(said, { childList: true, characterData: true, subtree: true });
}
"""


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[Rig]:
    with running_rig(tmp_path, "default", [], program=("-m", "services.cli.app", "up")) as rig:
        yield rig


def _page(rig: Rig) -> dict[str, str]:
    said: dict[str, str] = json.loads(page_file(Transport(directory=rig.directory / "bus")).read_text())
    return said


def _rig(address: str) -> Any:
    try:
        return httpx.get(f"{address}api/rig", timeout=PATIENCE_S).json()
    except httpx.TransportError:  # between two scenarios nobody answers
        return {"scene": ""}


def test_another_scenario_begins_at_the_same_address_with_the_same_token(rig: Rig) -> None:
    page, observer = _page(rig), rig.observer
    address, token = page["address"], {"X-Trocar-Token": page["token"], "X-Trocar-Before": "1 1"}
    assert httpx.post(f"{address}api/scenario", content="narrow", timeout=PATIENCE_S).status_code == 403
    unknown = httpx.post(f"{address}api/scenario", headers=token, content="../narow.yaml", timeout=PATIENCE_S)
    assert unknown.status_code == 400
    assert "there is no scenario '../narow.yaml'; known: basic, " in unknown.json()["error"]
    before = observer.pids()
    with Chromium(rig.directory / "profile") as browser:
        browser.open(f"{address}#token={page['token']}&face=instructor")
        may = "document.getElementById('scenario-run')?.disabled === false"
        browser.until(lambda: browser.evaluate(may), PATIENCE_S, "the instructor may switch")
        browser.until(lambda: browser.evaluate("document.getElementById('scenario').value") == "basic", PATIENCE_S, "")
        browser.evaluate(_HEAR)
        browser.evaluate("globalThis.old = true; document.getElementById('scenario').value = 'narrow'")
        order(browser, lambda: browser.evaluate("document.getElementById('scenario-run').click()"))
        browser.until(lambda: browser.evaluate("globalThis.old !== true"), START_S, "the page is loaded anew")
        browser.until(lambda: browser.text("#rig-name").endswith("narrow"), START_S, "it shows the other scene")
        heard = browser.evaluate("sessionStorage.getItem('heard') ?? ''")
        assert "narrow begins: a few seconds." in heard.splitlines()
        browser.until(lambda: browser.text("#tick").endswith(" s"), START_S, "a picture came")
        begun = "narrow: "
        browser.until(lambda: browser.text("#instructor-scenario").startswith(begun), START_S, "its attempt is shown")
        chosen = "document.getElementById('scenario').value"
        browser.until(lambda: browser.evaluate(chosen) == "narrow", PATIENCE_S, "and chosen")
        browser.screenshot(rig.directory / "instructor.png")
    assert _page(rig) == page
    assert _rig(address)["scenario"] == "narrow"
    kept = set(before.values())
    observer.until(lambda: kept.isdisjoint(observer.pids().values()), START_S, "every process is another")
    observer.until(lambda: observer.is_up, START_S, "it runs")
    assert len(list((rig.directory / "recordings").glob("*.mcap"))) == 2, "each scenario has its recording"
    assert rig.process.poll() is None
