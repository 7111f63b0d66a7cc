"""A newcomer with a mouse: takes the instruments at the page, grasps the catheter and slides it into the duct.

``python -m pytest tests/page/newcomer.py`` drives a real browser with the mouse beside a rig; not part of the suite,
as it takes a minute. ``python -m tests.page.newcomer docs/insertion.jpg`` does so too and keeps what it saw as a strip,
each picture drawn at the full resolution: the rig waits meanwhile for nobody, so its clock goes on.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import pytest
from PIL import Image

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
_DRAWS_S = 4.0
#: The governor is not to take a coarser step until a picture is taken.
FINER = """
const {governor} = trocar.view;
trocar.view.kept = [governor.steps, governor.at];
governor.steps = [{ratio: 1, look: "plain", shadows: false, hz: 2}];
governor.descend = () => false;
trocar.view.takeStep(0);
"""
AS_BEFORE = """
const {governor} = trocar.view;
[governor.steps, governor.at] = trocar.view.kept;
delete governor.descend;
trocar.view.takeStep();
"""


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
        n = max(2, round(8 * seconds))
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


@contextmanager
def newcomer(directory: Path) -> Iterator[Mouse]:
    """Start a rig whose instruments wait for a hand, and a browser with its page."""
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


def insert(mouse: Mouse, look: Callable[[], None] = lambda: None) -> None:
    """Slide the catheter in by mouse events alone; `look` is called at each stage."""
    browser = mouse.browser
    assert "Move the forceps yourself" in browser.text("#hand-hint")
    mouse.press("#toggle-dashboard")
    time.sleep(1.0)
    look()
    mouse.press("#take-hands")
    browser.until(lambda: browser.evaluate("document.querySelector('#hands.taken') !== null"), 20, "the hands are on")
    time.sleep(1.0)  # the eye has moved
    look()
    mouse.at = mouse.pixel(jaws_mm(mouse))
    while jaws_mm(mouse)[2] > 0.5:
        mouse.wheel(min(2.0, jaws_mm(mouse)[2] * 60 / WHEEL_NOTCH))
    mouse.at = mouse.pixel(jaws_mm(mouse))
    time.sleep(1.0)
    mouse.click()  # the jaws close on the catheter
    time.sleep(2.0)
    look()
    mouse.drag(mouse.pixel((66.0, 0.0, jaws_mm(mouse)[2])), 2.0)  # the tip before the mouth
    time.sleep(1.0)
    look()
    mouse.drag(mouse.pixel((57.0, 0.0, jaws_mm(mouse)[2])), 3.0)
    browser.until(lambda: inserted_mm(mouse) > INSERTED_MM, 60, "the catheter is in the duct")
    look()
    mouse.drag(mouse.pixel((45.0, 0.0, jaws_mm(mouse)[2])), 4.0)
    time.sleep(2.0)
    look()


def test_a_newcomer_with_a_mouse_inserts_the_catheter(tmp_path: Path) -> None:
    with newcomer(tmp_path) as mouse:
        insert(mouse)
        browser = mouse.browser
        browser.until(lambda: browser.text("#attempt-state").startswith("Well done"), 60, "the goal is reached")
        mouse.press("#attempt-again")
        browser.until(
            lambda: browser.text("#attempt-state").startswith("Begin") and browser.text("#depth-value") == "0.0 mm",
            60, "everything is back at its start",
        )  # fmt: skip
        mouse.move(mouse.pixel(jaws_mm(mouse)))
        before = jaws_mm(mouse)
        mouse.wheel(1.0)
        assert jaws_mm(mouse)[2] < before[2], "the hands are still this person's"


def strip(path: Path, columns: int = 3, width: int = 480) -> None:
    """Write what the newcomer sees at each stage, from left to right and down."""
    seen: list[Image.Image] = []

    def look() -> None:
        shot = directory / "shot.png"
        mouse.browser.evaluate(f"(() => {{{FINER}}})()")
        time.sleep(_DRAWS_S)
        mouse.browser.screenshot(shot)
        mouse.browser.evaluate(f"(() => {{{AS_BEFORE}}})()")
        image = Image.open(shot).convert("RGB")
        seen.append(image.resize((width, round(width * image.height / image.width)), Image.Resampling.LANCZOS))

    with tempfile.TemporaryDirectory() as made:
        directory = Path(made)
        with newcomer(directory) as mouse:
            insert(mouse, look)
    height = seen[0].height
    sheet = Image.new("RGB", (columns * width, -(-len(seen) // columns) * height))
    for i, image in enumerate(seen):
        sheet.paste(image, (i % columns * width, i // columns * height))
    sheet.save(path, quality=88)


if __name__ == "__main__":
    strip(Path(sys.argv[1]))
