"""The school at the page, by mouse alone: a name, the controls, mistakes as they happen, the report, the next task."""

from __future__ import annotations

import base64
import json
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests import chromium
from tests.page.looks import (
    LOOKS,
    Look,
    crossing,
    cut_words,
    keep_picture,
    looked_at,
    serious_faults,
    set_language,
    words_on_curves,
)
from tests.page.school_page import TOKEN, SchoolPage, assessed, replay, school_page
from tests.patience import PATIENCE_S
from tests.training.test_errors import CASES, judged, until_s
from trocar.review.export.png import grey_png
from trocar.services.supervisor.page.page_place import DIST
from trocar.services.training.errors import ERRORS, ErrorEvent

pytestmark = [
    pytest.mark.timeout(900),
    pytest.mark.skipif(chromium.find() is None, reason="no Chromium on this machine"),
    pytest.mark.skipif(not (DIST / "index.html").is_file(), reason="the page is not built"),
]
CRUSHED = ErrorEvent(
    code="E8", evidence="squeeze of the catheter", severity="consequential", phase="P4", begin_s=9.0, end_s=10.0,
    worst=3.4, limit=3.0, unit="N",
)  # fmt: skip
ID = "20261130T0-a"
_COVERED = """
[...document.querySelectorAll('header button, #sheet button, dialog[open] button')].filter((button) => {
  const { x, y, width, height } = button.getBoundingClientRect();
  if (!width || y < 0 || y + height > innerHeight) return false;
  if (document.querySelector('dialog[open]') && !button.closest('dialog')) return false;
  if (!document.querySelector('#sheet[hidden]') && !button.closest('#sheet, header')) return false;
  const at = document.elementFromPoint(x + 0.5 * width, y + 0.5 * height);
  return !button.contains(at);
}).map(({ id, textContent }) => id || textContent)
"""

#: What lies over the picture, and must not lie over each other.
_OVER_PICTURE = "#attempt, #tools li, #tags span, .hud.bottom :is(.hands p, .tools button)"

#: Nobody is asked anything, and the page speaks the language that is chosen.
_IS_IN = """
Boolean(globalThis.trocar?.school?.state?.trainee) && document.body.dataset.face === 'trainee'
  && document.documentElement.lang === (localStorage.getItem('trocar-language') ?? 'en')
  && document.getElementById('sheet').hidden
  && document.querySelector('dialog[open]') === null
"""


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SchoolPage]:
    with school_page(tmp_path_factory.mktemp("school")) as page:
        yield page


def arrive(page: SchoolPage, face: str = "trainee") -> None:
    page.browser.open("about:blank")
    page.browser.open(f"{page.address}/#token={TOKEN}&face={face}")
    page.until("Boolean(globalThis.trocar?.view?.last)", "a picture")


def enter(page: SchoolPage) -> None:
    """Say who one is, as a newcomer does, or be known from the last time."""
    arrive(page)
    page.until("Boolean(trocar.school.state)", "the school answers")
    if page.browser.text("#who") == "Who are you?":
        page.press("#new-name")
        page.press("#first-course")
        page.press("#know-controls")


def be_in(page: SchoolPage) -> None:
    """Enter, unless one is in already and nothing lies over the picture: a page takes many seconds to load here."""
    if not page.browser.evaluate(_IS_IN):
        enter(page)


def test_a_newcomer_gets_a_name_a_course_and_a_practice_by_mouse_alone(page: SchoolPage) -> None:
    arrive(page)
    page.press("#new-name")
    page.press("#first-course")
    page.press("#show-controls")
    name = page.browser.text("#who")
    assert page.bench.trainee == name
    assert page.browser.text("#course-now").startswith("Basics by mouse 1/")
    assert page.browser.text("#practice-count") == "1 of 7"
    assert "Take the instruments" in page.browser.text("#practice-ask")
    for k in range(7):
        page.until(f"document.getElementById('practice-count').textContent === '{k + 1} of 7'", f"step {k + 1}")
        page.press("#practice-skip")
    page.until("document.getElementById('practice').hidden", "the practice ends")
    page.browser.until(lambda: page.asked, 20.0, "everything is put back to its start")
    assert page.asked[-1].order.what == "new"
    arrive(page)
    page.until(f"document.getElementById('who').textContent === '{name}'", "the browser remembers the name")
    assert not page.sees("#welcome")


@pytest.mark.parametrize("code", ERRORS)
def test_each_mistake_is_told_at_the_page_within_half_a_second_and_once(page: SchoolPage, code: str) -> None:
    be_in(page)
    attempt_id = f"20261130T0-{code}"
    page.tell(attempt_id=attempt_id, state="running", errors={})
    page.until(f"trocar.attempt.attempt?.attempt_id === '{attempt_id}'", "the attempt runs")
    page.browser.evaluate(
        "globalThis.seenMs = 0; new MutationObserver(() => (globalThis.seenMs ||= Date.now()))"
        ".observe(document.getElementById('mistakes'), {childList: true})"
    )
    told_ms = time.time() * 1e3
    page.tell(attempt_id=attempt_id, state="running", errors={code: 1}, time_s=3.0)
    page.until(f"document.querySelectorAll('[data-code={code}]').length === 1", "the mistake is told", 20.0)
    late_ms = page.browser.evaluate("globalThis.seenMs") - told_ms
    print(f"{code}: told after {late_ms:.0f} ms")
    words = page.browser.text(f"[data-code={code}]")
    assert len(words) > 20
    assert code not in words, "a code is the engineer's"
    for _ in range(3):
        page.tell(attempt_id=attempt_id, state="running", errors={code: 1}, time_s=4.0)
        time.sleep(0.25)
    assert page.browser.evaluate(f"document.querySelectorAll('[data-code={code}]').length") <= 1, "told once"


@pytest.mark.parametrize(("code", "name"), CASES)
def test_a_near_miss_is_not_told_and_what_is_just_beyond_the_limit_is(page: SchoolPage, code: str, name: str) -> None:
    """What the judge makes of hands just within a limit, and just beyond it, is told to the page."""
    beyond, within = CASES[code, name]
    be_in(page)
    attempt_id = f"20261130T0-near-{code}-{list(CASES).index((code, name))}"
    coach, boxes = "trocar.school.coach", "[...document.querySelectorAll('.mistake-box')].map((e) => e.dataset.code)"
    clear = "document.getElementById('mistakes').replaceChildren()"
    page.browser.evaluate(f"{clear}; {coach}.told.clear()")
    page.tell(attempt_id=attempt_id, state="running", errors={}, time_s=1.0)
    page.until(f"{coach}.seen.id === '{attempt_id}'", "the attempt runs")
    judge, _ = judged(within, until_s(within))
    page.tell(attempt_id=attempt_id, state="running", errors=judge.errors, time_s=2.0)
    page.until("trocar.attempt.attempt?.time_s === 2", "the near miss has come")
    assert page.browser.evaluate(boxes) == []
    judge, _ = judged(beyond, until_s(beyond))
    page.tell(attempt_id=attempt_id, state="running", errors=judge.errors, time_s=3.0)
    page.until(f"{boxes}.length > 0", "the mistake is told")
    assert page.browser.evaluate(boxes) == [code]


def test_what_is_no_error_is_not_told_and_an_examination_tells_nothing(page: SchoolPage) -> None:
    enter(page)
    page.tell(attempt_id="20261130T0-none", state="running", errors={}, time_s=3.0)
    time.sleep(1.0)
    assert page.browser.evaluate("document.querySelectorAll('.mistake-box').length") == 0
    page.tell(attempt_id="20261130T0-none", state="running", errors={"E8": 1}, hint="", time_s=4.0, examined=True)
    time.sleep(1.0)
    assert page.browser.evaluate("document.querySelectorAll('.mistake-box').length") == 0
    assert page.browser.evaluate("document.getElementById('ghost').disabled")
    assert page.browser.text("#attempt-hint") == ""


def test_a_finished_attempt_is_reported_with_a_jump_into_its_replay(page: SchoolPage) -> None:
    enter(page)
    page.tell(attempt_id=ID, state="running", errors={}, from_tick=0)
    page.until(f"trocar.school.keeper.id === '{ID}'", "its pictures are kept")
    page.bench.replays.keep(ID, replay())
    page.bench.take_assessment(assessed(ID, CRUSHED), None)
    page.tell(attempt_id=ID, state="done", outcome="success", reason="10.0 mm deep after 20.0 s", score=220.0)
    page.until("!document.getElementById('sheet').hidden", "the report opens by itself")
    page.until("Boolean(trocar.player?.tracks?.length)", "the replay is loaded")
    shown = page.browser.text("#sheet-body")
    assert "220 points" in shown
    assert "You crushed or kinked the catheter (3.4 N, at most 3 N): 20 points." in shown
    assert "Close the jaws on the catheter only so far" in shown
    page.press(".jump")
    page.until("Math.abs(trocar.player.second - 7) < 0.2", "the replay is a little before the mistake")
    assert page.sees("#report-next")
    page.press("#report-next")
    page.until("document.getElementById('sheet').hidden", "the report is left for the next task")
    page.browser.until(lambda: page.asked, PATIENCE_S, "the next task is asked for")
    assert page.asked[-1].what in ("attempt", "switch")


def test_own_attempts_are_listed_and_two_are_seen_side_by_side(page: SchoolPage) -> None:
    enter(page)
    trainee = page.browser.text("#who")
    page.bench.trainee = trainee
    for name in ("20261130T1-a", "20261130T1-b"):
        page.bench.replays.keep(name, replay())
        page.bench.take_assessment(assessed(name), None)
    page.press("#my-attempts")
    page.until("document.querySelectorAll('table.attempts tbody tr').length >= 2", "the list")
    page.until("document.querySelectorAll('.seen[hidden]').length >= 2", "no page has seen their ends")
    heights = "[...document.querySelectorAll('.seen')].map((e) => e.getBoundingClientRect().height)"
    assert set(page.browser.evaluate(heights)) == {60}, "rows that move under a hand are missed"
    for k in (1, 2):
        page.press(f"table.attempts tbody tr:nth-child({k}) input")
    page.press("#sheet-body .controls button")
    page.until("trocar.player?.screens?.length === 2", "two replays")
    page.browser.evaluate("trocar.player.go(3)")
    ticks = page.browser.evaluate("trocar.player.screens.map(({ track }) => track.at(trocar.player.second).tick)")
    assert ticks[0] == ticks[1]
    page.press("#sheet-close")


def test_own_hands_go_on_from_a_second_of_an_attempt(page: SchoolPage) -> None:
    enter(page)
    page.bench.trainee = page.browser.text("#who")
    folder = page.context.rig.recorder.directory
    folder.mkdir(exist_ok=True)
    (folder / "own.mcap").write_bytes(b"")
    page.bench.replays.keep("20261130T2-a", replay())
    page.bench.take_assessment(assessed("20261130T2-a"), folder / "own.mcap")
    page.browser.evaluate(f"trocar.school.sheet.report({page.bench.state()['last']})")
    page.until("Boolean(trocar.player?.tracks?.length) && document.getElementById('go-on') !== null", "the replay")
    page.browser.evaluate("trocar.player.go(3)")
    page.press("#go-on")
    page.until(
        "document.getElementById('go-on-said').textContent.startsWith('The rig runs your attempt')", "it is told"
    )
    assert (page.asked[-1].what, page.asked[-1].line) == ("take_over", "own.mcap 3000 basic")
    page.press("#sheet-close")


def test_a_report_shows_the_cholangiogram_once_it_is_drawn(page: SchoolPage, monkeypatch: pytest.MonkeyPatch) -> None:
    enter(page)
    folder = page.context.rig.recorder.directory
    folder.mkdir(exist_ok=True)
    (folder / "own.mcap").write_bytes(b"")
    image = base64.b64encode(grey_png(np.full((48, 64), 128, np.uint8))).decode()
    still = {"image": image, "words": ["Agent reaches the common duct."]}
    monkeypatch.setattr("trocar.review.school.bench.asks_for_cholangiogram", lambda _name: True)
    answers = [None, None, json.dumps(still).encode()]  # it is still drawn, and then it is there
    monkeypatch.setattr(page.bench, "cholangiogram", lambda _number: answers.pop(0))
    page.bench.replays.keep("20261130T9-a", replay())
    page.bench.take_assessment(assessed("20261130T9-a"), folder / "own.mcap")
    page.browser.evaluate(f"trocar.school.sheet.report({page.bench.state()['last']})")
    page.until("document.querySelector('#cholangiogram img')?.naturalWidth === 64", "the picture")
    assert "Agent reaches the common duct." in page.browser.text("#cholangiogram")
    page.press("#sheet-close")


@pytest.mark.parametrize("look", LOOKS, ids=str)
def test_nothing_is_covered_or_cut_at_any_size(page: SchoolPage, look: Look) -> None:
    browser = page.browser
    be_in(page)
    set_language(browser, look.language)
    try:
        with looked_at(browser, look):
            be_in(page)
            for open_face in ("trocar.school.welcome()", "document.getElementById('keys').showModal()"):
                browser.evaluate(f"document.querySelectorAll('dialog').forEach((each) => each.close()); {open_face}")
                time.sleep(0.5)
                _look(page, f"{open_face}-{look}")
            browser.evaluate("document.querySelectorAll('dialog').forEach((each) => each.close())")
            _look(page, f"picture-{look}")
            _look_at_practice_and_mistakes(page, look)
            number = _finished_attempt(page)
            browser.evaluate(f"trocar.school.sheet.report({number}, trocar.school.state.next)")
            page.until("document.querySelectorAll('.track').length >= 3", "the report")
            _look(page, f"report-{look}")
            assert words_on_curves(browser) == []
            browser.evaluate("trocar.school.sheet.close()")
            _look_at_own_attempts(page, look)
    finally:
        set_language(browser, "en")


def _finished_attempt(page: SchoolPage) -> int:
    """Keep an attempt with a mistake and a replay; return its number."""
    page.bench.trainee = page.browser.text("#who")
    page.bench.replays.keep("20261130T4-a", replay())
    page.bench.take_assessment(assessed("20261130T4-a", CRUSHED), None)
    return int(page.bench.state()["last"])


def _look_at_practice_and_mistakes(page: SchoolPage, look: Look) -> None:
    """Look at the practice of the controls, and at three mistakes that are made in the same place at once."""
    page.browser.evaluate("trocar.school.practice.begin()")
    page.until("!document.getElementById('practice').hidden", "the practice")
    _look(page, f"practice-{look}")
    assert crossing(page.browser, f"{_OVER_PICTURE}, #practice") == []
    page.browser.evaluate("(() => { trocar.school.practice.onEnd = () => {}; trocar.school.practice.end(); })()")
    time.sleep(1.5)  # the eye moves once the task stands where the practice was, and with it the names of the tools
    page.browser.evaluate("['E8', 'E1', 'E13'].forEach((code) => trocar.school.coach.tell(code))")
    keep_picture(page.browser, f"mistakes-{look}")
    assert crossing(page.browser, f"{_OVER_PICTURE}, .mistake-box") == []
    assert page.browser.evaluate("document.querySelector('#mistakes > :last-child').dataset.code") == "E13"
    page.browser.evaluate("document.getElementById('mistakes').replaceChildren()")


def _look_at_own_attempts(page: SchoolPage, look: Look) -> None:
    """Look at the list of one's attempts, and at two of them side by side."""
    page.bench.trainee = page.browser.text("#who")
    for name in ("20261130T3-a", "20261130T3-b"):
        page.bench.replays.keep(name, replay())
        page.bench.take_assessment(assessed(name, CRUSHED), None)
    page.browser.evaluate(f"trocar.school.sheet.library('{page.bench.trainee}')")
    page.until("document.querySelectorAll('table.attempts tbody tr').length >= 2", "the list")
    _look(page, f"attempts-{look}")
    for k in (1, 2):
        page.browser.evaluate(f"document.querySelector('table.attempts tbody tr:nth-child({k}) input').click()")
    page.browser.evaluate("document.querySelector('#sheet-body .controls button').click()")
    page.until("trocar.player?.screens?.length === 2", "two replays")
    _look(page, f"side-by-side-{look}")
    assert words_on_curves(page.browser) == []
    screens = "[...document.querySelectorAll('.screens > *')].map((e) => e.getBoundingClientRect().toJSON())"
    one, other = page.browser.evaluate(screens)[:2]
    assert one["right"] <= other["left"] + 1 or one["bottom"] <= other["top"] + 1, "one lies over the other"
    assert min(one["width"], other["width"]) > 100, "each is large enough to see something"
    page.browser.evaluate("trocar.school.sheet.close()")


def _look(page: SchoolPage, what: str) -> None:
    assert page.browser.evaluate(_COVERED) == [], what
    assert page.browser.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0, what
    assert cut_words(page.browser) == [], what
    assert serious_faults(page.browser) == [], what
    keep_picture(page.browser, what)


def test_the_page_speaks_german_and_loses_no_sentence(page: SchoolPage) -> None:
    browser = page.browser
    browser.evaluate("localStorage.setItem('trocar-language', 'de')")
    try:
        enter_known(page)
        page.tell(hint="Push on: 6 mm to go.", state="running")
        page.until("document.getElementById('attempt-hint').textContent === 'Weiter: noch 6 mm.'", "a hint in German")
        assert browser.text("#take-hands") == "Instrumente nehmen"
        assert browser.text("#my-attempts") == "Meine Versuche"
        assert browser.evaluate("document.documentElement.lang") == "de"
    finally:
        browser.evaluate("localStorage.setItem('trocar-language', 'en')")


def enter_known(page: SchoolPage) -> None:
    arrive(page)
    page.until("Boolean(trocar.school.state?.trainee)", "the browser knows who trains")


def test_a_message_of_the_desk_is_shown(page: SchoolPage) -> None:
    be_in(page)
    page.bench.say("Come over, please.", "dr-b")
    page.until("document.getElementById('desk-message').textContent === 'dr-b: Come over, please.'", "the message")


def test_the_address_of_a_replay_is_no_way_out_of_its_folder(page: SchoolPage, tmp_path: Path) -> None:
    be_in(page)
    status = page.browser.evaluate(
        f"fetch('school/replay/..%2f..%2fa.sqlite', {{headers: {{'X-Trocar-Token': '{TOKEN}'}}}}).then((a) => a.status)"
    )
    assert status in (400, 404)
    status = page.browser.evaluate("fetch('school/state').then((answer) => answer.status)")
    assert status == 403, "without a token nobody is told anything"
