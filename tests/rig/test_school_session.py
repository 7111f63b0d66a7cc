"""A session from a new profile by mouse alone, on a real rig: name, attempts, report, replay, curve, next task."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests import chromium
from tests.chromium import Chromium
from tests.page.newcomer import UP, Mouse, attempt
from tests.patience import PATIENCE_S
from tests.rig.conftest import running_rig

pytestmark = [
    pytest.mark.rig,
    pytest.mark.timeout(1200),
    pytest.mark.skipif(chromium.find() is None, reason="no Chromium on this machine"),
]
ATTEMPTS = 3
_READY = "document.getElementById('depth-value').textContent === '0.0 mm'"


@pytest.fixture
def mouse(tmp_path: Path) -> Iterator[Mouse]:
    overrides = ["training.scenario=basic"]
    with (
        running_rig(tmp_path, "default", overrides, ("training.attempt",), rig="mouse", program=UP) as rig,
        Chromium(tmp_path / "profile", size=(1000, 640)) as browser,
    ):
        yield Mouse(rig, browser)


def _report(mouse: Mouse) -> str:
    """Wait for the report that opens by itself, with its replay; return what it says."""
    browser = mouse.browser
    browser.until(lambda: mouse.sees("#sheet-close"), PATIENCE_S, "the report opens")
    browser.until(lambda: browser.evaluate("Boolean(trocar.player?.screens?.length)"), PATIENCE_S, "the replay")
    return browser.text("#sheet-body")


def test_a_session_from_a_new_profile(mouse: Mouse) -> None:
    mouse.arrive()
    browser, told = mouse.browser, []
    trainee = browser.text("#who")
    for number in range(1, ATTEMPTS + 1):
        course = attempt(mouse, 600.0)
        told.append(course)
        print(number, course)
        assert course.headline.startswith("Well done"), course
        assert "late" not in course.not_counted, "nothing is late in simulated time"
        shown = _report(mouse)
        assert "points" in shown
        assert "Your curve" in shown
        if mouse.sees(".jump"):
            mouse.press(".jump")
            assert browser.evaluate("trocar.player.second") >= 0.0
        mouse.press("#report-next")
        browser.until(lambda: browser.evaluate(_READY), PATIENCE_S, "the next attempt is ready")
        if mouse.sees("#hands.taken"):
            mouse.press("#take-hands")
    mouse.press("#my-attempts")
    rows = "document.querySelectorAll('table.attempts tbody tr').length"
    browser.until(lambda: browser.evaluate(rows) == ATTEMPTS, PATIENCE_S, f"all attempts of {trainee} are listed")
