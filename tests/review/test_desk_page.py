"""The class page in a browser: benches are commanded by mouse, attempts rated, and nothing overlaps at any size."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests import chromium
from tests.chromium import Chromium
from tests.page.looks import cut_words
from tests.page.school_page import assessed
from tests.page.test_school_page import AXE, CRUSHED
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


@pytest.mark.parametrize(
    ("scheme", "width", "language"),
    [*((s, w, "en") for s in ("dark", "light") for w in (390, 1280, 1920)), ("light", 390, "de"), ("dark", 1280, "de")],
)
def test_nothing_overlaps_or_is_cut_at_any_size(
    desk: DeskPage, scheme: str, width: int, language: str, tmp_path: Path
) -> None:
    browser = desk.browser
    browser.set_size(width, 900)
    browser.command("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
    desk.until(f"innerWidth === {width}", "the size was taken")
    if browser.evaluate("document.documentElement.lang") != language:
        choose = f"node.value = '{language}'; node.dispatchEvent(new Event('change'))"
        browser.evaluate(f"(() => {{ const node = document.getElementById('language'); {choose} }})()")
        desk.until(f"document.documentElement.lang === '{language}'", "the language was taken")
        desk.until("document.querySelectorAll('#rigs article').length === 10", "ten benches")
    assert cut_words(browser) == []
    assert browser.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
    overlaps = """(() => {
      const all = [...document.querySelectorAll('#rigs article, main > section')];
      const boxes = all.map((e) => e.getBoundingClientRect());
      return boxes.flatMap((a, i) => boxes.slice(i + 1).filter((b) => a.left < b.right - 1 && b.left < a.right - 1
        && a.top < b.bottom - 1 && b.top < a.bottom - 1)).length;
    })()"""
    assert browser.evaluate(overlaps) == 0
    browser.screenshot(tmp_path / f"desk-{width}-{scheme}.png")
    browser.evaluate(f"{AXE.read_text(encoding='utf-8')}; true")
    found = browser.evaluate(
        "axe.run(document, {resultTypes: ['violations']}).then(({violations}) => violations"
        ".filter(({impact}) => ['serious', 'critical'].includes(impact)).map((e) => e.id + e.nodes[0].target))"
    )
    assert found == []
