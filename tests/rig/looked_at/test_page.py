"""The page of a running rig in a real browser that draws in software on the same cores: what it shows is true."""

from __future__ import annotations

import itertools
import json
import os
import re
import signal
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx
import pytest

from tests import chromium
from tests.chromium import Chromium
from tests.page.orders import order
from tests.patience import PATIENCE_S
from tests.rig.conftest import Rig
from tests.rig.looked_at.conftest import WINDOW_S
from trocar.protocol.bodies import Health, Stall
from trocar.services.runtime.config.rig import Transport
from trocar.services.supervisor.page.page_place import page_file

pytestmark = [
    pytest.mark.rig,
    pytest.mark.timeout(600),
    pytest.mark.skipif(chromium.find() is None, reason="no Chromium on this machine"),
]


@dataclass
class Page:
    """A rig, and a browser that looks at its page."""

    rig: Rig
    browser: Chromium
    client: httpx.Client

    def metrics(self) -> dict[str, float]:
        """Return what Prometheus would get."""
        text = self.client.get("metrics", params={"level": "full"}).text
        return {
            line.rpartition(" ")[0]: float(line.rpartition(" ")[2]) for line in text.splitlines() if line[:1] != "#"
        }

    def state(self) -> Any:
        """Return what the dashboard was last sent."""
        return self.client.get("api/state").json()

    def picture_time_s(self) -> float:
        """Return the rig's time as the picture shows it."""
        words = self.browser.text("#tick")
        return float(words.split()[0]) if words.endswith(" s") else float("nan")


@pytest.fixture(scope="module")
def page(rig: Rig, address: str, browser: Chromium) -> Iterator[Page]:
    with httpx.Client(base_url=address, timeout=PATIENCE_S) as client:
        yield Page(rig, browser, client)


def test_pictures_advance_with_the_rig(page: Page) -> None:
    began_s = page.picture_time_s()
    page.browser.until(lambda: page.picture_time_s() > began_s + 0.3, PATIENCE_S, "the picture went on")


def test_the_canvas_is_drawn_on(page: Page, tmp_path: Path) -> None:
    """A picture of one colour is none: what is to be seen has a duct, instruments and a background."""
    import numpy as np
    from PIL import Image

    page.browser.screenshot(tmp_path / "page.png")
    pixels = np.asarray(Image.open(tmp_path / "page.png").convert("RGB"))[250:600, 150:650].reshape(-1, 3)
    colours = np.unique(pixels // 16, axis=0)
    assert len(colours) > 50
    assert pixels.std(axis=0).min() > 8.0


def test_it_says_in_small_print_how_it_draws_and_the_rig_sends_no_more_than_it_asked_for(page: Page) -> None:
    def asked_hz() -> float:
        words = page.browser.text("#drawn-how")
        assert words.startswith("This browser draws on the processor: ")
        found = re.search(r"(\d+) pictures a second asked for", words)
        assert found is not None
        return float(found[1])

    assert asked_hz() <= 20.0  # the most that is asked for in software
    browser = page.browser
    made = "the rig makes as many pictures"
    browser.until(lambda: _target_hz(page, "visualization") == asked_hz(), PATIENCE_S, made)


def test_an_attempt_is_followed_and_begins_again_from_the_page(page: Page) -> None:
    """With the session's token; a trainee sees the clock go, and then stand at nought until somebody moves."""
    browser, rig = page.browser, page.rig
    token = json.loads(page_file(Transport(directory=rig.directory / "bus")).read_text())["token"]
    assert browser.evaluate("document.getElementById('attempt-again').disabled")
    browser.evaluate(f"location.hash = 'token={token}&face=trainee'")
    browser.until(lambda: browser.text("#attempt-clock") > "0:00", PATIENCE_S, "the clock goes: the hands move")
    assert browser.text("#attempt-title") == "Practice without a goal"
    before = page.state()["attempt"]
    press = "document.getElementById('attempt-again').click()"
    assert order(browser, lambda: browser.evaluate(press)) == "a new attempt begins"
    browser.until(lambda: page.state()["attempt"]["began_tick"] > before["began_tick"], PATIENCE_S, "it has begun")
    assert page.state()["attempt"]["attempt_id"] != before["attempt_id"]
    browser.evaluate("location.hash = 'face=engineer'")
    browser.until(lambda: browser.evaluate("document.body.dataset.face") == "engineer", PATIENCE_S, "as it was")


_DRAWN = """({
  step: trocar.view.governor.at, width: document.querySelector('#scene').width,
  words: document.querySelector('#drawn-how').textContent,
})"""
#: Drawing a picture takes so many milliseconds longer. What was drawn before is read in the same breath: a page that
#: draws slowly anyhow takes a coarser step as soon as it is let.
_BURDEN = f"""(() => {{
  const {{ stage }} = trocar.view, draw = stage.draw;
  stage.draw = () => {{
    draw.call(stage);
    for (const until = performance.now() + 300; performance.now() < until;);
  }};
  trocar.view.takeStep(3);
  return {_DRAWN};
}})()"""
#: Drawing takes no time and every picture that comes is painted, whatever else this machine does. What is drawn is kept
#: from step to step: who asks now and then may come too late for one.
_RELIEF = f"""(() => {{
  const {{ stage, governor }} = trocar.view, look = governor.look, takeStep = trocar.view.takeStep;
  stage.draw = () => {{}};
  governor.look = (seen) => look.call(governor, {{ ...seen, cost: 0.1, painted: seen.offered }});
  trocar.view.drawn = [];
  trocar.view.takeStep = (...at) => {{
    takeStep.apply(trocar.view, at);
    trocar.view.drawn.push({_DRAWN});
  }};
}})()"""
_AS_BEFORE = """(() => {
  const { view } = trocar;
  delete view.stage.draw;
  delete view.governor.look;
  delete view.takeStep;
})()"""


@pytest.mark.long
def test_the_resolution_falls_under_load_and_comes_back(page: Page) -> None:
    """The governor's rules are tried by day, without a browser (`web/test/governor.test.js`).

    The load is drawing that takes long, whoever causes it: no more of what a machine does is seen by a page."""
    browser = page.browser

    def drawn() -> Any:
        return browser.evaluate(_DRAWN)

    began = drawn()["step"]
    try:
        before = browser.evaluate(_BURDEN)
        assert before["step"] == 3
        browser.until(lambda: drawn()["step"] >= 6, PATIENCE_S, "it draws more coarsely")
        loaded = drawn()
        assert loaded["width"] < 0.8 * before["width"]
        share = round(100 * loaded["width"] / browser.evaluate("document.querySelector('#scene').clientWidth"))
        assert f" {share} % of the resolution" in loaded["words"], loaded
        browser.evaluate(_RELIEF)
        steps: list[Any] = []

        def is_as_before() -> bool:
            steps[:] = [each for each in browser.evaluate("trocar.view.drawn") if each["step"] <= 3]
            return bool(steps)

        browser.until(is_as_before, PATIENCE_S, "it draws as before")
        assert steps[0] == before
    finally:
        browser.evaluate(_AS_BEFORE)
        browser.evaluate(f"trocar.view.takeStep({began})")


def _loop(page: Page, name: str) -> Any:
    (row,) = [row for row in page.state()["processes"] if row["name"] == name]
    return row["loop"]


def _target_hz(page: Page, name: str) -> float:
    """Return the rate that a loop aims at, 0 while the supervisor has not counted it for long enough."""
    loop = _loop(page, name)
    return float(loop["target_hz"]) if loop else 0.0


_SHOWN = """({
  state: trocar.dashboard.shown,
  rates: Object.fromEntries([...document.querySelectorAll('#processes .tile')].map((tile) =>
    [tile.querySelector('strong span').textContent, tile.querySelector('.numbers').textContent])),
  switches: Object.fromEntries([...document.querySelectorAll('#threads tbody tr')].map((row) =>
    [row.children[0].textContent, row.children[2].textContent])),
})"""
_LOOPS = ("gateway", "haptics", "physics")


class Exported:
    """What `/metrics` said of one process, over some seconds: counts by the uptime of their report, and in their order.

    A rate that the page shows is then of two of these, whatever the machine did meanwhile: the page's figures are of
    the reports that its server heard, and so are the metrics.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.ticks: dict[float, float] = {}
        self.switches: list[float] = []

    def take(self, metrics: dict[str, float]) -> None:
        uptime_s = metrics[f'trocar_service_uptime_seconds{{service="{self.name}"}}']
        self.ticks[uptime_s] = metrics[f'trocar_loop_iterations_total{{loop="{self.name}"}}']
        kinds = (f'kind="{kind}",service="{self.name}"' for kind in ("wanted", "preempted"))
        self.switches.append(sum(metrics[f"trocar_context_switches_total{{{labels}}}"] for labels in kinds))

    def rate_hz(self, uptime_s: float, window_s: float) -> float | None:
        """Return the rate over the window before the report at `uptime_s`, None where one of its ends was not seen."""
        ends = [[seen for seen in self.ticks if abs(seen - at) < 1e-3] for at in (uptime_s - window_s, uptime_s)]
        if not all(ends):
            return None
        (first, *_), (last, *_) = ends
        return (self.ticks[last] - self.ticks[first]) / (last - first)

    def rises(self) -> list[float]:
        """Return by how much the switches rose from one look of the page's server at them to the next."""
        return [after - before for before, after in itertools.pairwise(self.switches) if after > before]


def test_numbers_agree_with_metrics(page: Page) -> None:
    exported = {name: Exported(name) for name in _LOOPS}
    agreed: set[tuple[str, str]] = set()
    until_s = time.monotonic() + PATIENCE_S
    while len(agreed) < 2 * len(_LOOPS):
        assert time.monotonic() < until_s, f"no two reports to compare with, or other figures; agreed: {agreed}"
        metrics = page.metrics()
        for each in exported.values():
            each.take(metrics)
        shown = page.browser.evaluate(_SHOWN)
        for row in shown["state"]["processes"]:
            if row["name"] in exported:
                agreed |= _agreed(row, shown, exported[row["name"]])


def _agreed(row: Any, shown: Any, exported: Exported) -> set[tuple[str, str]]:
    """Check what the page shows of a process against what was exported; return what could be compared."""
    name, loop, usage = row["name"], row["loop"], row["usage"]
    found = set()
    window_s = loop["ticks"] / loop["rate_hz"]
    rate_hz = exported.rate_hz(row["uptime_s"], window_s)
    if rate_hz is not None:
        assert window_s > WINDOW_S - 0.1, name
        assert float(shown["rates"][name].split(" of ")[0]) == pytest.approx(rate_hz, abs=0.51), name
        found.add((name, "rate"))
    if usage is not None:
        counted = float(shown["switches"][name]) * usage["seconds"]
        if any(counted == pytest.approx(rise, abs=usage["seconds"]) for rise in exported.rises()):
            found.add((name, "switches"))
    return found


_STAGES = """
Object.fromEntries([...document.querySelectorAll('.stage-group')].map((group) => [
  group.querySelector('h3').textContent,
  Object.fromEntries([...group.querySelectorAll('.stage')].map(({ children: [name, , numbers] }) =>
    [name.textContent, numbers.textContent])),
]))
"""


def test_stages_on_the_page_are_those_of_metrics(page: Page) -> None:
    shown: dict[str, dict[str, str]] = {}
    names = {"gateway", "haptics", "physics", "visualization", "recorder"}
    page.browser.until(
        lambda: shown.update(page.browser.evaluate(_STAGES)) or names <= shown.keys(), PATIENCE_S, "all stages"
    )
    metrics = page.metrics()
    for name in names:
        exported = {
            m[1]
            for key in metrics
            if (m := re.match(rf'trocar_stage_seconds_count{{loop="{name}",stage="(.*)"}}', key))
        }
        assert exported == shown[name].keys()
        for words in shown[name].values():
            assert re.fullmatch(r"[\d.]+( ms)? · [\d.]+( ms)? · [\d.]+( ms)?", words), (name, words)
    count = metrics['trocar_stage_seconds_count{loop="physics",stage="solve"}']
    assert count == pytest.approx(metrics['trocar_loop_iterations_total{loop="physics"}'], rel=0.1)
    judges = re.compile(r"judges \d\d(\.\d)? times a second, now at most [\d.]+ (µs|ms) late")
    page.browser.until(lambda: judges.search(page.browser.text("#judge")), PATIENCE_S, "who judges is told of")


@dataclass
class Stalls:
    """The stalls of physics as its own loop has measured them: what the history is to tell, each once."""

    rig: Rig
    seen: dict[int, Stall] = field(default_factory=dict)
    reports: int = 0

    def look(self) -> None:
        self.rig.observer.look()
        for frame in self.rig.observer.bus.drain("physics.health"):
            body: Health = frame.body
            self.reports += 1
            if body.loop is not None:
                self.seen.update({stall.index: stall for stall in body.loop.stalls})

    def until_calm(self) -> None:
        """Wait until some reports have told nothing new, so that all is in the history that there is."""
        deadline_s, calm = time.monotonic() + PATIENCE_S, 0
        while calm < _CALM:
            assert time.monotonic() < deadline_s, f"this machine stalls all the time: {self.seen}"
            known, reports = len(self.seen), self.reports
            time.sleep(0.05)
            self.look()
            calm = 0 if len(self.seen) > known else calm + self.reports - reports


#: So many reports, of ten a second.
_CALM = 4
_LENGTHS = re.compile(r"physics: stalled for ([\d, ]+) ms")


@pytest.mark.parametrize(
    "length_ms", [pytest.param(20, marks=pytest.mark.long), 100, pytest.param(400, marks=pytest.mark.long)]
)
def test_the_history_shows_a_stall_once_with_its_length(page: Page, length_ms: int) -> None:
    """Of the one that the test makes, and of all that this machine makes beside it: as the loop has measured them."""
    stalls = Stalls(page.rig)
    stalls.until_calm()
    known, before = dict(stalls.seen), Counter(_history(page))
    late = _lengths(known.values()) - _told(before)  # of those before: the page may be behind, and tell them yet
    pid = page.rig.observer.pids()["physics"]
    os.kill(pid, signal.SIGSTOP)
    stopped_ns = time.monotonic_ns()
    time.sleep(length_ms / 1e3)
    continued_ns = time.monotonic_ns()
    os.kill(pid, signal.SIGCONT)

    def new() -> list[Stall]:
        stalls.look()
        return [stall for index, stall in stalls.seen.items() if index not in known]

    def is_told() -> bool:
        told, own = _told(Counter(_history(page)) - before), _lengths(new())
        return not own - told and not told - own - late

    page.browser.until(lambda: any(stall.ended_ns >= continued_ns for stall in new()), PATIENCE_S, "it measures it")
    own = min((stall for stall in new() if stall.ended_ns >= continued_ns), key=lambda stall: stall.ended_ns)
    assert own.length_ns > continued_ns - stopped_ns - 1_000_000
    page.browser.until(is_told, PATIENCE_S, "the history shows it")
    stalls.until_calm()
    page.browser.until(is_told, PATIENCE_S, "and once")


def _lengths(stalls: Iterable[Stall]) -> Counter[str]:
    return Counter(f"{stall.length_ns * 1e-6:.0f}" for stall in stalls)


def _told(lines: Counter[str]) -> Counter[str]:
    return Counter(
        length for line in lines.elements() for all_ms in _LENGTHS.findall(line) for length in all_ms.split(", ")
    )


def _history(page: Page) -> list[str]:
    """Return the lines of the history that tell of a stall of physics, each with its time."""
    lines = page.browser.evaluate("[...document.querySelectorAll('#events li')].map((line) => line.textContent)")
    return [line for line in lines if "physics: stalled for " in line]


def test_the_page_answers_while_the_rig_works_and_the_browser_draws(page: Page) -> None:
    """How soon is `benchmarks/bench_page.py`'s to say."""
    for path in ("", "metrics", "api/state", "healthz") * 5:
        assert page.client.get(path).status_code == 200, path


_TOO_WIDE = """
[...document.querySelectorAll('body *')]
  .filter((element) => !element.closest('.scroll, .u-wrap') && element.getBoundingClientRect().right > innerWidth + 1)
  .map(({ tagName, id, className }) => [tagName, id, className])
"""


@pytest.mark.parametrize(("width", "height"), [(1280, 800)])
def test_nothing_is_wider_than_the_screen(page: Page, width: int, height: int) -> None:
    browser = page.browser
    try:
        browser.set_size(width, height)
        browser.until(lambda: browser.evaluate("innerWidth") == width, PATIENCE_S, "the size was taken")
        browser.until(lambda: browser.evaluate(_TOO_WIDE) == [], PATIENCE_S, "everything fits")
        assert browser.evaluate("document.documentElement.scrollWidth") <= width
    finally:
        browser.set_size(1280, 800)
