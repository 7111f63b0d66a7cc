"""At the page of a rig as anybody starts it: a newcomer with a mouse, and then an instructor with another scenario.

The newcomer follows what the page says: the goal is reached in time, the score read, all begun again. The instructor
begins another scenario from the page: address and token stay, and what cannot be run is refused.
"""

from __future__ import annotations

from typing import Any

import httpx
import pytest

from tests import chromium
from tests.page.conftest import Made, make_attempt
from tests.page.newcomer import MOST_S, Mouse, access, jaws_mm
from tests.page.orders import order
from tests.patience import PATIENCE_S
from tests.rig.conftest import START_S

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


@pytest.mark.parametrize("run", [1, *(pytest.param(k, marks=pytest.mark.long) for k in range(2, 6))])
def test_a_newcomer_reaches_the_goal_reads_the_score_and_begins_again(mouse: Mouse, first: Made, run: int) -> None:
    """The time is that of the attempt's clock, which the rig keeps: a busy machine has no part in it."""
    course = (first if run == 1 else make_attempt(mouse)).course
    assert course.headline.startswith("Well done"), course
    assert course.clock_s <= MOST_S, course
    assert [each.split()[0] for each in course.hints[:2]] == ["Grasp", "Lead"], "the page said what to do"
    assert course.score.startswith("Score "), course
    assert 300.0 - MOST_S - 60.0 < float(course.score.split()[1]) < 300.0, course
    assert mouse.browser.text("#attempt-score") == ""
    mouse.move(mouse.pixel(jaws_mm(mouse)))
    before = jaws_mm(mouse)
    mouse.wheel(3.0)  # by 5 mm; an attempt begins at 4
    assert jaws_mm(mouse)[2] < before[2], "the hands are still this person's"
    browser = mouse.browser
    browser.until(lambda: not browser.text("#attempt-state").startswith("Begin"), PATIENCE_S, "the next attempt runs")


def _rig(address: str) -> Any:
    try:
        return httpx.get(f"{address}api/rig", timeout=PATIENCE_S).json()
    except httpx.TransportError:  # between two scenarios nobody answers
        return {"scene": ""}


def test_another_scenario_begins_at_the_same_address_with_the_same_token(mouse: Mouse) -> None:
    """The rig is another one then."""
    rig, browser, page = mouse.rig, mouse.browser, access(mouse.rig)
    observer, address = rig.observer, page["address"]
    token = {"X-Trocar-Token": page["token"], "X-Trocar-Before": "1 1"}
    assert httpx.post(f"{address}api/scenario", content="narrow", timeout=PATIENCE_S).status_code == 403
    unknown = httpx.post(f"{address}api/scenario", headers=token, content="../narow.yaml", timeout=PATIENCE_S)
    assert unknown.status_code == 400
    assert "there is no scenario '../narow.yaml'; known: basic, " in unknown.json()["error"]
    observer.look()
    before = observer.pids()
    browser.open(f"{address}#token={page['token']}&face=instructor")
    may = "document.getElementById('scenario-run')?.disabled === false"
    browser.until(lambda: browser.evaluate(may), PATIENCE_S, "the instructor may switch")
    chosen = "document.getElementById('scenario').value"
    browser.until(lambda: browser.evaluate(chosen) == "basic", PATIENCE_S, "what runs is chosen")
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
    browser.until(lambda: browser.evaluate(chosen) == "narrow", PATIENCE_S, "and chosen")
    assert [access(rig)[each] for each in ("address", "token")] == [page["address"], page["token"]]
    assert access(rig)["scene"] == "narrow"
    assert _rig(address)["scenario"] == "narrow"
    kept = set(before.values())
    observer.until(lambda: kept.isdisjoint(observer.pids().values()), START_S, "every process is another")
    observer.until(lambda: observer.is_up, START_S, "it runs")
    assert len(list((rig.directory / "recordings").glob("*.mcap"))) == 2, "each scenario has its recording"
    assert rig.process.poll() is None
