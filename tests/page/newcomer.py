"""A newcomer with a mouse: takes the instruments at the page and does what the page says, until it says well done.

``python -m tests.page.newcomer docs/insertion.jpg`` keeps what it sees on the way as a strip, each picture drawn at the
full resolution: the rig waits meanwhile for nobody, so its clock goes on. `test_default_rig.py` is the test, and
`school_session.py` counts how often attempts succeed.
"""

from __future__ import annotations

import json
import re
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from PIL import Image

from tests.chromium import Chromium
from tests.page.orders import order
from tests.patience import PATIENCE_S
from tests.rig.conftest import Rig, running_rig
from trocar.services.runtime.config.rig import Transport
from trocar.services.supervisor.page.page_place import page_file

UP = ("-m", "trocar.services.cli.app", "up")
INSERTED_MM = 5.0
#: Within so long a newcomer is to reach the goal.
MOST_S = 90.0
#: Where the jaws are when the tip is before the mouth, how low they take the catheter, and a push.
BEFORE_MM, LOW_MM, PUSH_MM, PUSH_S = 66.0, 0.5, 4.0, 0.6
WHEEL_NOTCH = 100
_DRAWS_S = 4.0
#: The eye has come to rest when so many looks in a row find a point of the world within so many pixels.
_STILL_LOOKS, _STILL_PX = 5, 1.0
#: So long a newcomer waits for what the page says of closed jaws.
_CLOSES_S = 2.0
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

    def __init__(self, rig: Rig, browser: Chromium) -> None:
        self.rig, self.browser = rig, browser
        self.at = (0.0, 0.0)

    def arrive(self) -> None:
        """Open the rig's page, which has not been open."""
        page = access(self.rig)
        self.browser.open("about:blank")
        self.browser.open(f"{page['address']}#token={page['token']}")
        is_ready = "document.querySelector('#view.ready') !== null"
        self.browser.until(lambda: self.browser.evaluate(is_ready), PATIENCE_S, "the page loaded")
        self.say_who()

    def say_who(self) -> None:
        """Take the name and the course that the page offers, unless the browser knows who trains."""
        known = "Boolean(trocar.school.state)"
        self.browser.until(lambda: self.browser.evaluate(known), PATIENCE_S, "the school answers")
        if self.browser.text("#who") != "Who are you?":
            return
        for selector in ("#new-name", "#first-course", "#know-controls"):
            self.browser.until(lambda at=selector: self.sees(at), PATIENCE_S, f"{selector} is seen")
            self.press(selector)
        self.browser.until(lambda: not self.sees("#know-controls"), PATIENCE_S, "the picture is free")

    def sees(self, selector: str) -> bool:
        return bool(self.browser.evaluate(f"document.querySelector({selector!r})?.getClientRects().length > 0"))

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
    """Start a rig whose instruments wait for a hand, as anybody starts one, and a browser."""
    with (
        running_rig(directory, "default", [], ("training.attempt",), rig="mouse", program=UP) as rig,
        Chromium(directory / "profile", size=(800, 560)) as browser,
    ):
        yield Mouse(rig, browser)


def access(rig: Rig) -> dict[str, str]:
    """Return the address of a rig's page and its token."""
    said: dict[str, str] = json.loads(page_file(Transport(directory=rig.directory / "bus")).read_text())
    return said


def jaws_mm(mouse: Mouse) -> list[float]:
    """Return where the hand wants the jaws of the tool that it holds."""
    return list(mouse.browser.evaluate("trocar.hands.grip.jaws"))


def inserted_mm(mouse: Mouse) -> float:
    words = mouse.browser.text("#inserted")
    return float(words.split()[0]) if words.endswith(" mm") else 0.0


def insert(mouse: Mouse, look: Callable[[], None] = lambda: None) -> None:
    """Slide the catheter in by mouse events alone; `look` is called at each stage."""
    take(mouse, look)
    grasp(mouse)
    look()
    draw_to(mouse, BEFORE_MM, 2.0)
    look()
    draw_to(mouse, 57.0, 3.0)
    mouse.browser.until(lambda: inserted_mm(mouse) > INSERTED_MM, PATIENCE_S, "the catheter is in the duct")
    look()
    draw_to(mouse, 45.0, 4.0)
    time.sleep(1.0)
    look()


def take(mouse: Mouse, look: Callable[[], None] = lambda: None) -> None:
    """Take the instruments, as the page says one may."""
    browser = mouse.browser
    assert "Move the forceps yourself" in browser.text("#hand-hint")
    mouse.press("#toggle-dashboard")
    until_eye_rests(mouse)
    look()
    mouse.press("#take-hands")
    browser.until(
        lambda: browser.evaluate("document.querySelector('#hands.taken') !== null"), PATIENCE_S, "the hands are on"
    )
    until_eye_rests(mouse)
    look()


def until_eye_rests(mouse: Mouse) -> None:
    """Wait until the picture has its size and the eye its place."""
    seen: list[tuple[float, float]] = []

    def rests() -> bool:
        seen.append(mouse.pixel((0.0, 0.0, 0.0)))
        last = seen[-_STILL_LOOKS:]
        return len(last) == _STILL_LOOKS and all(max(way) - min(way) < _STILL_PX for way in zip(*last, strict=True))

    mouse.browser.until(rests, PATIENCE_S, "the eye rests")


def grasp(mouse: Mouse) -> None:
    """Lower the jaws around the catheter, and close them there."""
    if mouse.browser.text("#hand-jaws") == "Open jaws":
        mouse.press("#hand-jaws")
        time.sleep(1.0)
    mouse.at = mouse.pixel(jaws_mm(mouse))
    while jaws_mm(mouse)[2] > LOW_MM:
        mouse.wheel(min(2.0, jaws_mm(mouse)[2] * 60 / WHEEL_NOTCH))
    mouse.at = mouse.pixel(jaws_mm(mouse))
    time.sleep(0.5)
    said, until_s = mouse.browser.text("#attempt-hint"), time.monotonic() + _CLOSES_S
    mouse.click()  # the jaws close on the catheter
    while mouse.browser.text("#attempt-hint") == said and time.monotonic() < until_s:
        time.sleep(0.1)
    time.sleep(0.3)


def draw_to(mouse: Mouse, x_mm: float, seconds: float) -> None:
    """Draw the jaws along the axis of the duct, to so far before its middle."""
    mouse.at = mouse.pixel(jaws_mm(mouse))
    mouse.drag(mouse.pixel((x_mm, 0.0, jaws_mm(mouse)[2])), seconds)
    time.sleep(0.3)


def obey(mouse: Mouse) -> str:
    """Do what the page's hint says just now, and return the hint."""
    said = mouse.browser.text("#attempt-hint")
    at_mm = jaws_mm(mouse)[0]
    if said.startswith("Grasp the catheter"):
        grasp(mouse)
    elif said.startswith("Lead the tip"):
        draw_to(mouse, BEFORE_MM if at_mm > BEFORE_MM + 1.0 else at_mm - PUSH_MM, PUSH_S)
    elif to_go := re.match(r"Push on: (\d+) mm", said):
        draw_to(mouse, at_mm - min(PUSH_MM, float(to_go[1])), PUSH_S)
    elif said.startswith("Gently"):
        draw_to(mouse, at_mm - 2.0, PUSH_S)
    elif said.startswith(("Less force", "Too deep")):
        draw_to(mouse, at_mm + 2.0, 1.0)
    else:
        time.sleep(0.2)
    return said


@dataclass
class Course:
    """What came of it: the attempt's own clock, and all the time since the page was there, with what was said."""

    headline: str
    clock_s: float
    since_page_s: float
    score: str
    not_counted: str
    hints: list[str]


def attempt(mouse: Mouse, most_s: float = 300.0) -> Course:
    """Make an attempt, from the first look at the page to what it says at the end."""
    began_s, hints = time.monotonic(), [""]
    take(mouse)
    while not (headline := mouse.browser.text("#attempt-state")).startswith(("Well done", "Not yet")):
        assert time.monotonic() - began_s < most_s, f"{headline}: {hints}"
        said = obey(mouse)
        hints += [said] * (said != hints[-1])
    minutes, seconds = mouse.browser.text("#attempt-clock").split(":")
    return Course(
        headline, 60.0 * float(minutes) + float(seconds), time.monotonic() - began_s,
        mouse.browser.text("#attempt-score"), mouse.browser.text("#attempt-not"), hints[1:],
    )  # fmt: skip


def begin_again(mouse: Mouse) -> None:
    """Put everything back to its start, from the page, and leave the report that has opened."""
    browser = mouse.browser
    browser.until(lambda: mouse.sees("#sheet-close"), PATIENCE_S, "the report is there")
    mouse.press("#sheet-close")
    assert order(browser, lambda: mouse.press("#attempt-again")) == "a new attempt begins"
    browser.until(
        lambda: browser.text("#attempt-state").startswith("Begin") and browser.text("#depth-value") == "0.0 mm",
        PATIENCE_S, "everything is back at its start",
    )  # fmt: skip


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
            mouse.arrive()
            insert(mouse, look)
    height = seen[0].height
    sheet = Image.new("RGB", (columns * width, -(-len(seen) // columns) * height))
    for i, image in enumerate(seen):
        sheet.paste(image, (i % columns * width, i // columns * height))
    sheet.save(path, quality=88)


if __name__ == "__main__":
    strip(Path(sys.argv[1]))
