"""The class page in a browser: benches are commanded by mouse, attempts rated, and nothing overlaps at any size."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests import chromium
from tests.chromium import Chromium
from tests.page.looks import LOOKS, Look, crossing, cut_words, keep_picture, looked_at, serious_faults
from tests.page.school_page import assessed
from tests.page.test_school_page import CRUSHED
from tests.patience import PATIENCE_S
from tests.review.class_of_pages import TOKEN, rigs, served, state, write_roll
from trocar.protocol import bodies
from trocar.review.attempts.store.attempts import Store
from trocar.review.classroom.app import Classroom, build_app
from trocar.services.supervisor.control.commands import Command

pytestmark = [
    pytest.mark.timeout(600),
    pytest.mark.skipif(chromium.find() is None, reason="no Chromium on this machine"),
]


@dataclass
class DeskPage:
    """A browser on the class page, the database behind it, and what benches were asked for."""

    browser: Chromium
    database: Path
    asked: list[Command]

    def press(self, selector: str) -> None:
        self.until(f"document.querySelector({selector!r})?.getClientRects().length > 0", f"{selector} is seen")
        element = f"document.querySelector({selector!r})"
        self.browser.evaluate(f"{element}.scrollIntoView({{block: 'center'}})")
        script = f"{element}.getBoundingClientRect().toJSON()"
        box = self.browser.evaluate(script)
        at = {"x": box["x"] + 0.5 * box["width"], "y": box["y"] + 0.5 * box["height"]}
        for kind, down in (("mousePressed", 1), ("mouseReleased", 0)):
            self.browser.command("Input.dispatchMouseEvent", type=kind, button="left", clickCount=1, buttons=down, **at)

    def until(self, expression: str, what: str) -> None:
        self.browser.until(lambda: self.browser.evaluate(expression), PATIENCE_S, what)


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Iterator[DeskPage]:
    folder = tmp_path_factory.mktemp("desk")
    database, asked = folder / "a.sqlite", list[Command]()
    with Store(str(database)) as store:
        for k in range(3):
            store.add(assessed(f"20261130T{k}-a", CRUSHED, total=200.0 + 10 * k), "heron-17", folder / "a.mcap")
    with rigs(10) as (contexts, addresses):
        for context in contexts:
            context.latest = state(incarnation=7, t=1.0)
            context.class_token = TOKEN

            def ask(command: Command) -> bodies.Answer:
                asked.append(command)
                return bodies.Answer(order=0, ok=True, text="a new attempt begins")

            context.ask = ask
        roll = write_roll(folder / "class.toml", addresses, more=f'database = "{database}"', bench_0="heron-17")
        classroom = Classroom(roll)
        try:
            with served(build_app(classroom)) as [address], Chromium(folder / "profile") as browser:
                browser.open(f"{address}/#token={TOKEN}")
                page = DeskPage(browser, database, asked)
                page.until("document.querySelectorAll('#rigs article').length === 10", "ten benches")
                page.until("document.querySelectorAll('#class tr').length === 1", "the class table")
                yield page
        finally:
            classroom.close()


def test_all_benches_begin_at_one_click_and_each_says_what_it_did(desk: DeskPage) -> None:
    desk.press("#all-go")
    desk.until(
        "[...document.querySelectorAll('#rigs .said')].every((e) => e.textContent === 'a new attempt begins')", ""
    )
    assert len(desk.asked) == 10
    desk.press("#rigs article:nth-child(4) .pause")
    desk.browser.until(lambda: len(desk.asked) == 11, PATIENCE_S, "one bench pauses")
    order = desk.asked[-1].order
    assert order is not None
    assert order.what == "pause"


def test_an_attempt_is_rated_and_the_rating_kept(desk: DeskPage) -> None:
    desk.press("#class tr button")
    desk.press("#one-body table button")
    desk.until("document.querySelectorAll('#one-body select').length === 12", "both scales")
    desk.browser.evaluate("document.querySelectorAll('#one-body .ratings select')[2].value = '4'")
    desk.press("#one-body button.go")
    desk.until("document.querySelector('#one-body p[role=status]')?.textContent === 'Kept with the attempt.'", "kept")
    with Store(str(desk.database)) as store:
        assert [(note.kind, note.data) for note in store.notes(kind="goals")] == [("goals", {"Efficiency": 4})]
    desk.press("#one [data-close]")


@pytest.mark.parametrize("look", LOOKS, ids=str)
def test_nothing_overlaps_or_is_cut_at_any_size(desk: DeskPage, look: Look) -> None:
    browser = desk.browser
    with looked_at(browser, look):
        if browser.evaluate("document.documentElement.lang") != look.language:
            choose = f"node.value = '{look.language}'; node.dispatchEvent(new Event('change'))"
            browser.evaluate(f"(() => {{ const node = document.getElementById('language'); {choose} }})()")
            desk.until(f"document.documentElement.lang === '{look.language}'", "the language was taken")
            desk.until("document.querySelectorAll('#rigs article').length === 10", "ten benches")
            desk.until("document.querySelectorAll('#class tr').length === 1", "the class table")
        _look(browser, f"desk-{look}")
        assert crossing(browser, "#rigs article, main > section") == []
        for name, at, there in _DIALOGS:
            if not at.startswith("#one"):
                browser.evaluate("document.getElementById('one').close()")
            desk.press(at)
            desk.until(f"document.querySelector({there!r}) !== null", name)
            _look(browser, f"desk-{name}-{look}")
        browser.evaluate("document.getElementById('one').close()")


#: What opens each dialog, and what is in it: a trainee's attempts and curve, an attempt to be judged, and the journal.
_DIALOGS = [
    ("trainee", "#class tr button", "#one-body svg"),
    ("judging", "#one-body table button", "#one-body .ratings"),
    ("journal", "#journal-show", "#one-body > ol"),
]


def _look(browser: Chromium, what: str) -> None:
    assert cut_words(browser) == [], what
    assert browser.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0, what
    too_wide = "[...document.querySelectorAll('dialog[open]')].some((e) => e.scrollWidth > e.clientWidth + 1)"
    assert not browser.evaluate(too_wide), what
    assert serious_faults(browser) == [], what
    keep_picture(browser, what)
