"""Orders from a page, given as a person gives them: once more where one came too late to be carried out."""

from __future__ import annotations

from collections.abc import Callable

from tests.chromium import Chromium
from tests.patience import PATIENCE_S

#: What is said of an order of which nothing came: the page, or the rig, stood still for as long as anybody waits.
_NOTHING_DONE = ("too late", "not reachable")
_BEGIN = "globalThis.ordered = true; document.getElementById('instructor-said').textContent = ''"
_ANSWER = "globalThis.ordered ? document.getElementById('instructor-said').textContent : 'another page'"


def order(browser: Chromium, press: Callable[[], object]) -> str:
    """Press until the rig has obeyed; return what it said of that, or that the page is another one by now."""
    said: list[str] = []
    while not said or any(each in said[-1] for each in _NOTHING_DONE):
        browser.evaluate(_BEGIN)
        press()
        browser.until(lambda: said.append(browser.evaluate(_ANSWER)) or said[-1], PATIENCE_S, "what came of it is said")
    return said[-1]
