"""Newcomers without a mouse: one with a keyboard, one with fingers; each slides the catheter in by that alone.

``python -m pytest tests/page/other_newcomers.py``; not part of the suite, as each takes a minute and both cores.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import pytest

from tests import chromium
from tests.chromium import Chromium
from tests.page.newcomer import INSERTED_MM, Mouse, inserted_mm, jaws_mm, newcomer
from tests.patience import PATIENCE_S

pytestmark = [
    pytest.mark.rig,
    pytest.mark.timeout(400),
    pytest.mark.skipif(chromium.find() is None, reason="no Chromium on this machine"),
]

#: Where the jaws take the catheter to, in mm: its tip before the mouth, and into it.
MOUTH_MM, INSIDE_MM = (66.0, 0.0), (45.0, 0.0)
NEAR_MM, LOW_MM, KEY_MM_S = 0.8, 0.5, 20.0


class Keyboard:
    """Looks at the page and presses keys."""

    def __init__(self, browser: Chromium) -> None:
        self.browser = browser

    def hold(self, code: str, seconds: float = 0.05) -> None:
        for kind in ("rawKeyDown", "keyUp"):
            self.browser.command("Input.dispatchKeyEvent", type=kind, code=code, key=code.removeprefix("Key").lower())
            time.sleep(seconds)

    def go(self, person: Mouse, to_mm: tuple[float, float]) -> None:
        right, away = self.browser.evaluate("Object.values(trocar.view.stage.levelAxes())")
        for _ in range(40):
            x, y = (wanted - is_at for wanted, is_at in zip(to_mm, jaws_mm(person), strict=False))
            ways = (("ArrowRight", "ArrowLeft", right), ("ArrowUp", "ArrowDown", away))
            far, code = max((abs(s := x * a[0] + y * a[1]), there if s > 0.0 else back) for there, back, a in ways)
            if far < NEAR_MM:
                return
            self.hold(code, min(1.0, far / KEY_MM_S))
        pytest.fail(f"the jaws are at {jaws_mm(person)} mm")


class Fingers:
    """Touches the picture."""

    def __init__(self, browser: Chromium) -> None:
        self.browser = browser

    def touch(self, kind: str, *points: tuple[float, float]) -> None:
        at: list[dict[str, Any]] = [{"x": x, "y": y, "id": k} for k, (x, y) in enumerate(points)]
        self.browser.command("Input.dispatchTouchEvent", type=f"touch{kind}", touchPoints=at)

    def second(self, first: tuple[float, float], right_px: float, down_px: float) -> None:
        """Put a second finger beside the first one and move it."""
        x, y = first[0] + 80.0, first[1]
        self.touch("Start", first)
        self.touch("Start", first, (x, y))
        for k in range(1, 11):
            self.touch("Move", first, (x + right_px * k / 10, y + down_px * k / 10))
        self.touch("End", first)
        self.touch("End")

    def go(self, person: Mouse, to_mm: tuple[float, float]) -> None:
        (x, y), (to_x, to_y) = person.pixel(jaws_mm(person)), person.pixel((*to_mm, jaws_mm(person)[2]))
        self.touch("Start", (x, y))
        for k in range(1, 41):
            self.touch("Move", (x + (to_x - x) * k / 40, y + (to_y - y) * k / 40))
            time.sleep(0.1)
        self.touch("End")


def take(person: Mouse) -> Chromium:
    """Take the instruments."""
    browser = person.browser
    person.arrive()
    person.press("#toggle-dashboard")
    time.sleep(1.0)
    person.press("#take-hands")
    browser.until(
        lambda: browser.evaluate("document.querySelector('#hands.taken') !== null"), PATIENCE_S, "the hands are on"
    )
    time.sleep(1.0)  # the eye has moved
    return browser


def until_in(person: Mouse) -> None:
    person.browser.until(lambda: inserted_mm(person) > INSERTED_MM, PATIENCE_S, "the catheter is in the duct")


def test_keys_alone_insert_the_catheter_and_turn_the_other_tool(tmp_path: Path) -> None:
    with newcomer(tmp_path) as person:
        browser, keys = take(person), Keyboard(person.browser)
        while jaws_mm(person)[2] > LOW_MM:
            keys.hold("KeyS", 0.1)
        keys.hold("Space")
        assert browser.text("#hand-jaws") == "Open jaws"
        time.sleep(2.0)
        for to_mm in (MOUTH_MM, INSIDE_MM):
            keys.go(person, to_mm)
        until_in(person)
        keys.hold("Tab")
        assert browser.text("#hand-which") == "Hand: right"
        roll = browser.evaluate("trocar.hands.grip.roll")
        keys.hold("KeyE", 0.3)
        assert browser.evaluate("trocar.hands.grip.roll") > roll


def test_fingers_alone_insert_the_catheter_and_turn_the_other_tool(tmp_path: Path) -> None:
    with newcomer(tmp_path) as person:
        browser, fingers = take(person), Fingers(person.browser)
        browser.command("Emulation.setTouchEmulationEnabled", enabled=True, maxTouchPoints=5)
        while jaws_mm(person)[2] > LOW_MM:
            fingers.second(person.pixel(jaws_mm(person)), 0.0, 20.0)
        assert browser.text("#hand-jaws") == "Close jaws", "two fingers close nothing"
        fingers.touch("Start", person.pixel(jaws_mm(person)))
        fingers.touch("End")
        assert browser.text("#hand-jaws") == "Open jaws"
        time.sleep(2.0)
        for to_mm in (MOUTH_MM, INSIDE_MM):
            fingers.go(person, to_mm)
        until_in(person)
        person.press("#hand-which")
        roll = browser.evaluate("trocar.hands.grip.roll")
        fingers.second(person.pixel(jaws_mm(person)), 50.0, 0.0)
        assert browser.evaluate("trocar.hands.grip.roll") > roll
