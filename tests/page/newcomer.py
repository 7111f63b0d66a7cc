"""A newcomer with a mouse: takes the instruments at the page, grasps the catheter and slides it into the duct.

``python -m pytest tests/page/newcomer.py``: it drives a real browser with the mouse. Not part of the suite: where
the browser draws in software beside the rig, a picture a second, each event takes most of a second, two minutes in all.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Sequence

import pytest

from services.runtime.rig import Transport
from services.supervisor.page_place import page_file
from tests import chromium
from tests.chromium import Chromium
from tests.rig.conftest import running_rig

pytestmark = [
    pytest.mark.rig,
    pytest.mark.timeout(400),
    pytest.mark.skipif(chromium.find() is None, reason="no Chromium on this machine"),
]

INSERTED_MM = 5.0
WHEEL_NOTCH = 100


class Mouse:
    """A mouse over the page. It may look: where a point of the world is in the picture."""

    def __init__(self, browser: Chromium) -> None:
        self.browser = browser
        self.at = (0.0, 0.0)

    def _event(self, kind: str, **more: object) -> None:
        x, y = self.at
        self.browser.command("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)

    def pixel(self, point_mm: Sequence[float]) -> tuple[float, float]:
        found = self.browser.evaluate(f"trocar.view.stage.pixelOf({list(point_mm)})")
        return found["x"], found["y"]

    def move(self, to: tuple[float, float], seconds: float = 0.3, **held: object) -> None:
        x, y = self.at
        n = max(2, round(3 * seconds))  # a browser that draws in software takes most of a second for each
        for k in range(1, n + 1):
            self.at = (x + (to[0] - x) * k / n, y + (to[1] - y) * k / n)
            self._event("mouseMoved", **held)
            time.sleep(seconds / n)

    def click(self) -> None:
        self._event("mousePressed", button="left", clickCount=1, buttons=1)
        self._event("mouseReleased", button="left", clickCount=1)

    def drag(self, to: tuple[float, float], seconds: float) -> None:
        self._event("mousePressed", button="left", clickCount=1, buttons=1)
        self.move(to, seconds, button="left", buttons=1)
        self._event("mouseReleased", button="left", clickCount=1)

    def wheel(self, notches: float) -> None:
        self._event("mouseWheel", deltaX=0, deltaY=WHEEL_NOTCH * notches)
        time.sleep(0.1)

    def press(self, selector: str) -> None:
        box = self.browser.evaluate(f"document.querySelector({selector!r}).getBoundingClientRect().toJSON()")
        self.at = (box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"])
        self.click()


@pytest.fixture(scope="module")
def mouse(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Mouse]:
    directory = tmp_path_factory.mktemp("hands")
    with (
        running_rig(directory, "default", [], rig="mouse"),
        Chromium(directory / "profile", size=(800, 560)) as browser,
    ):
        access = json.loads(page_file(Transport(directory=directory / "bus")).read_text())
        browser.open(f"{access['address']}#token={access['token']}")
        browser.until(lambda: browser.evaluate("document.querySelector('#view.ready') !== null"), 60, "the page loaded")
        yield Mouse(browser)


def jaws_mm(mouse: Mouse) -> list[float]:
    """Return where the hand wants the jaws of the tool that it holds."""
    return list(mouse.browser.evaluate("trocar.hands.grip.jaws"))


def inserted_mm(mouse: Mouse) -> float:
    words = mouse.browser.text("#inserted")
    return float(words.split()[0]) if words.endswith(" mm") else 0.0


def test_a_newcomer_with_a_mouse_inserts_the_catheter(mouse: Mouse) -> None:
    browser = mouse.browser
    assert "Move the forceps yourself" in browser.text("#hand-hint")
    mouse.press("#toggle-dashboard")
    mouse.press("#take-hands")
    browser.until(lambda: browser.evaluate("document.querySelector('#hands.taken') !== null"), 20, "the hands are on")
    time.sleep(1.0)  # the eye has moved
    mouse.at = mouse.pixel(jaws_mm(mouse))
    while jaws_mm(mouse)[2] > 0.5:
        mouse.wheel(min(2.0, jaws_mm(mouse)[2] * 60 / WHEEL_NOTCH))
    mouse.at = mouse.pixel(jaws_mm(mouse))
    time.sleep(1.0)
    mouse.click()  # the jaws close on the catheter
    time.sleep(2.0)
    mouse.drag(mouse.pixel((66.0, 0.0, jaws_mm(mouse)[2])), 2.0)  # the tip before the mouth
    mouse.drag(mouse.pixel((45.0, 0.0, jaws_mm(mouse)[2])), 6.0)
    browser.until(lambda: inserted_mm(mouse) > INSERTED_MM, 60, "the catheter is in the duct")
