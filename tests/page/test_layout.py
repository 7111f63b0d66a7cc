"""The page at the sizes of desks and phones, without a rig: nothing covers a button, nothing is too wide."""

from __future__ import annotations

import functools
import http.server
import re
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests import chromium
from tests.chromium import Chromium
from tests.page.looks import cut_words
from tests.patience import PATIENCE_S
from trocar.services.supervisor.page.page_place import DIST

pytestmark = [
    pytest.mark.timeout(600),
    pytest.mark.skipif(chromium.find() is None, reason="no Chromium on this machine"),
    pytest.mark.skipif(not (DIST / "index.html").is_file(), reason="the page is not built"),
]

_SIZES = [(1920, 1080), (1280, 800), (800, 560), (390, 844), (844, 390)]
#: What a rig with instruments for a page's hands, long words and small print would show.
_FULL = """
document.getElementById('hands').hidden = false;
document.getElementById('rig-reason').textContent = 'physics: 2608 ticks lost in the last minute, budget 60';
document.getElementById('rig-name').textContent = 'mouse · everything';
document.getElementById('drawn-how').textContent =
  'This browser draws on the processor: 50 % of the resolution, coarse shapes, 12 pictures a second asked for.';
"""
#: An attempt that is told of, and what is seen of it.
_ATTEMPT = Path(__file__).with_name("attempt_layout.js").read_text(encoding="utf-8")
_COVERED = """
[...document.querySelectorAll('header button, #view button')].filter((button) => {
  const { x, y, width, height } = button.getBoundingClientRect();
  return width && [[0.1, 0.1], [0.5, 0.5], [0.9, 0.9]].some(([a, b]) =>
    !button.contains(document.elementFromPoint(x + a * width, y + b * height)));
}).map(({ id, textContent }) => id || textContent)
"""
#: A recording with a long name that is shown.
_REPLAY = """trocar.replay.update(
  { file: '20261123-120000-default-rig.mcap', place_s: 83.2, length_s: 3600, halted: true, rate: 1, loop: true })"""
#: What the page would ask of a rig, kept.
_ASKED = "globalThis.asked = []; globalThis.fetch = (path, { body }) => (asked.push(body), Promise.reject());"
_TOO_WIDE = "document.documentElement.scrollWidth - innerWidth"
#: Why the rig is degraded, and that a safe stop was not heard, is said there.
_SAID = """(() => {
  const said = document.getElementById('rig-reason'), { x, y, width, height } = said.getBoundingClientRect();
  return width > 100 && height > 10 && document.elementFromPoint(x + 5, y + 0.5 * height) === said;
})()"""


class _Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None:
        """Say nothing."""


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chromium]:
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(_Quiet, directory=DIST)) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        profile: Path = tmp_path_factory.mktemp("layout") / "profile"
        with Chromium(profile) as browser:
            browser.open(f"http://127.0.0.1:{server.server_port}/")
            browser.until(lambda: browser.evaluate("Boolean(globalThis.trocar?.hands)"), 170, "the page loaded")
            browser.evaluate(_FULL)
            browser.evaluate(f"{_ATTEMPT};layout.tell()")
            yield browser
        server.shutdown()


@pytest.fixture(scope="module")
def german(browser: Chromium) -> Iterator[Chromium]:
    """Return the browser with the page in German; the last to use the page, as it is loaded anew."""
    address = browser.evaluate("location.origin")
    browser.evaluate("localStorage.setItem('trocar-language', 'de')")
    browser.open("about:blank")
    browser.open(f"{address}/")
    browser.until(lambda: browser.evaluate("Boolean(globalThis.trocar?.hands)"), 60, "the page is loaded anew")
    browser.evaluate(_FULL)
    browser.evaluate(f"{_ATTEMPT};layout.tell()")
    yield browser
    browser.evaluate("localStorage.removeItem('trocar-language')")


@pytest.mark.parametrize("taken", [False, True], ids=["free", "taken"])
@pytest.mark.parametrize(("width", "height"), _SIZES)
def test_no_button_is_covered_and_nothing_too_wide(browser: Chromium, width: int, height: int, *, taken: bool) -> None:
    browser.set_size(width, height)
    browser.evaluate(f"trocar.hands.show({str(taken).lower()})")
    browser.until(lambda: browser.evaluate("innerWidth") == width, 170, "the size was taken")
    assert browser.evaluate(_COVERED) == []
    assert browser.evaluate(_TOO_WIDE) <= 0
    assert browser.evaluate(_SAID)


@pytest.mark.parametrize(("width", "height"), _SIZES)
def test_the_controls_of_a_replay_find_their_place(browser: Chromium, width: int, height: int) -> None:
    browser.set_size(width, height)
    browser.evaluate(f"trocar.hands.show(false); document.getElementById('hands').hidden = true; {_REPLAY}")
    try:
        browser.until(lambda: browser.evaluate("innerWidth") == width, 170, "the size was taken")
        assert browser.evaluate(_COVERED) == []
        assert browser.evaluate(_TOO_WIDE) <= 0
        assert browser.evaluate("document.getElementById('replay-place').getBoundingClientRect().width") >= 80
    finally:
        browser.evaluate("trocar.replay.update(null); document.getElementById('hands').hidden = false")


@pytest.mark.parametrize("scheme", ["dark", "light"])
@pytest.mark.parametrize("face", ["trainee", "instructor"])
@pytest.mark.parametrize(("width", "height"), _SIZES)
def test_trainee_and_instructor_find_everything_at_its_place(
    browser: Chromium, width: int, height: int, face: str, scheme: str
) -> None:
    browser.set_size(width, height)
    browser.command("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
    browser.evaluate(f"trocar.hands.show(false); location.hash = 'token=t&face={face}'")
    browser.until(lambda: browser.evaluate("innerWidth") == width, 170, "the size was taken")
    browser.until(lambda: browser.evaluate("document.body.dataset.face") == face, 170, "the hash was heard")
    assert browser.evaluate(_COVERED) == []
    assert browser.evaluate(_TOO_WIDE) <= 0
    assert browser.evaluate("layout.overlaps()") == 0
    shown = browser.evaluate("document.body.innerText")
    assert "does not count: the rig was late" in shown
    assert ("air or leak" in shown) is (face == "instructor")
    assert not re.search(r"\b[EP]\d", shown), "codes are the engineer's"
    assert face == "instructor" or not {"us", "µs"} & set(shown.split()), "an engineer's figures"
    ratio = browser.evaluate("layout.contrasts()")
    assert min(ratio.values()) >= 4.5, ratio


@pytest.mark.parametrize(("width", "height"), _SIZES)
def test_the_clock_and_the_score_are_not_broken_into_lines(browser: Chromium, width: int, height: int) -> None:
    browser.set_size(width, height)
    browser.evaluate("location.hash = 'face=trainee'; layout.tell('done')")
    try:
        browser.until(lambda: browser.evaluate("innerWidth") == width, 170, "the size was taken")
        browser.until(lambda: browser.evaluate("document.body.dataset.face") == "trainee", 170, "the hash was heard")
        for name in ("attempt-clock", "attempt-limit", "attempt-score"):
            assert browser.evaluate(f"document.getElementById('{name}').innerText"), name
            assert browser.evaluate(f"layout.lines('{name}')") == 1, name
    finally:
        browser.evaluate("layout.tell()")


def test_the_keyboard_alone_reaches_every_control_of_the_attempt(browser: Chromium) -> None:
    browser.set_size(1280, 800)
    browser.evaluate("location.hash = 'token=t&face=instructor'; document.activeElement?.blur()")
    browser.until(lambda: browser.evaluate("document.body.dataset.face") == "instructor", 170, "the hash was heard")
    reached = set()
    for _ in range(60):
        for kind in ("keyDown", "keyUp"):
            browser.command("Input.dispatchKeyEvent", type=kind, key="Tab", code="Tab", windowsVirtualKeyCode=9)
        reached.add(browser.evaluate("document.activeElement.id || document.activeElement.dataset.order"))
    assert {"face", "attempt-again", "new", "pause", "slow", "bookmark", "instructor-mirror"} <= reached
    browser.evaluate(
        "globalThis.asked = []; globalThis.fetch = (path, { body }) => { asked.push(body); return Promise.reject(); }"
    )
    browser.evaluate("document.activeElement.blur()")
    browser.command("Input.dispatchKeyEvent", type="keyDown", key="b", code="KeyB", windowsVirtualKeyCode=66)
    assert browser.evaluate("asked") == ['{"what":"new","value":0}']


def test_the_instructors_button_says_whether_the_picture_is_mirrored(browser: Chromium) -> None:
    browser.evaluate("location.hash = 'token=t&face=instructor'")
    browser.until(lambda: browser.evaluate("document.body.dataset.face") == "instructor", 170, "the hash was heard")
    seen = []
    for _ in range(2):
        browser.evaluate("document.getElementById('instructor-mirror').click()")
        both = (
            browser.evaluate(f"document.getElementById('{name}').ariaPressed")
            for name in ("mirror", "instructor-mirror")
        )
        seen.append(tuple(both))
    assert seen == [("true", "true"), ("false", "false")]


def test_the_sound_comes_on_demand_and_follows_the_force(browser: Chromium) -> None:
    browser.set_size(1280, 800)
    browser.evaluate("location.hash = 'face=trainee'; document.getElementById('hands').hidden = false")
    browser.evaluate("trocar.hands.show(true)")
    assert browser.evaluate("trocar.hands.tone.context === undefined"), "silent until somebody asks"
    _click(browser, "hand-tone")
    browser.evaluate("trocar.hands.tone.sound(1.0)")
    assert browser.evaluate("document.getElementById('hand-tone').ariaPressed") == "true"
    gain, hertz = "trocar.hands.tone.gain.gain.value", "trocar.hands.tone.voice.frequency.value"
    browser.until(lambda: browser.evaluate(gain) > 0.03 and browser.evaluate(hertz) > 400, PATIENCE_S, "it sounds")
    _click(browser, "hand-tone")
    browser.until(lambda: browser.evaluate(gain) < 1e-3, PATIENCE_S, "it is silent again")
    browser.evaluate("trocar.hands.show(false)")


def _click(browser: Chromium, name: str) -> None:
    """Press a button with the mouse: a browser makes no sound where nobody has."""
    box = browser.evaluate(f"document.getElementById('{name}').getBoundingClientRect().toJSON()")
    at = {"x": box["x"] + 0.5 * box["width"], "y": box["y"] + 0.5 * box["height"], "button": "left", "clickCount": 1}
    for kind in ("mousePressed", "mouseReleased"):
        browser.command("Input.dispatchMouseEvent", type=kind, **at)


def test_the_plot_of_forces_makes_room_for_what_comes(browser: Chromium) -> None:
    """First nothing but a limit, then forces far below it."""
    browser.evaluate("location.hash = 'face=engineer'")
    browser.until(lambda: browser.evaluate("document.body.dataset.face") == "engineer", 170, "the hash was heard")
    show = """((t, newton) => {
      const board = trocar.dashboard;
      board.waits = () => false;
      board.peaks = () => [{ name: 'left', newton }];
      board.update({ t, state: 'running', attempt: { force_limit_n: 2.6 } });
      board.show();
    })"""
    for t, newton in enumerate(("null", "null", "0.02", "0.03")):
        browser.evaluate(f"{show}({1000 + t}, {newton})")
    lowest = "trocar.dashboard.forces.plot.scales.y.min"
    browser.until(lambda: 0.0 < (browser.evaluate(lowest) or 0.0) <= 0.02, PATIENCE_S, "it reaches down to the forces")


@pytest.mark.parametrize("face", ["trainee", "instructor", "engineer"])
@pytest.mark.parametrize(("width", "height"), [(390, 844), (1280, 800)])
def test_german_words_find_their_place_too(german: Chromium, width: int, height: int, face: str) -> None:
    german.set_size(width, height)
    german.until(lambda: german.evaluate("innerWidth") == width, 170, "the size was taken")
    for taken in (False, True):
        german.evaluate(f"trocar.hands.show({str(taken).lower()}); location.hash = 'token=t&face={face}'")
        german.until(lambda: german.evaluate("document.body.dataset.face") == face, 170, "the hash was heard")
        assert german.evaluate("document.documentElement.lang") == "de"
        assert german.evaluate(_COVERED) == []
        assert german.evaluate(_TOO_WIDE) <= 0
        assert german.evaluate("layout.overlaps()") == 0
        assert cut_words(german) == []
