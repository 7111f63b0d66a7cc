"""The report: everything is in one file, says what is to be practised, and a browser draws it, dark and light."""

from __future__ import annotations

import html as html_text
import re
from collections.abc import Iterator
from itertools import chain
from pathlib import Path

import msgspec
import pytest

from tests import chromium
from tests.patience import PATIENCE_S
from tests.review.test_assess import assessed, told
from tests.training.streams import GOOD, changed, messages
from tests.training.test_errors import CASES
from trocar.protocol.bodies import SupervisorState
from trocar.review.attempts.advice import advice
from trocar.review.attempts.assessment import Assessment
from trocar.review.attempts.experts import band_of
from trocar.review.attempts.figures import ticks
from trocar.review.attempts.report import Past, render
from trocar.services.training.score import load_rules

RULES = load_rules()
ERRING = CASES["E1", "traction"][0] | CASES["E10", "air flushed in"][0]


@pytest.fixture(scope="module")
def good() -> Assessment:
    return assessed(told(messages(GOOD), 16.0))


@pytest.fixture(scope="module")
def erring() -> Assessment:
    late = ("supervisor.state", 1, SupervisorState(state="degraded", reason="physics: <60> ticks lost"))
    return assessed(told(chain(messages(changed(ERRING)), [late]), 16.0))


def past(found: Assessment, times_s: list[float]) -> list[Past]:
    return [
        Past(
            began_ns=k, outcome="success", counts=True, time_s=time_s, total=300.0 - time_s, errors=0,
            metrics=found.metrics | {"time_s": time_s},
        )
        for k, time_s in enumerate(times_s)
    ]  # fmt: skip


def test_the_costliest_error_is_what_to_practise(erring: Assessment) -> None:
    assert [sentence.split()[0] for sentence in advice(erring, RULES, {})] == ["Flush", "Hold"]


def test_without_errors_it_is_what_is_farthest_from_the_experts(good: Assessment) -> None:
    band = band_of([{**good.metrics, "time_s": 8.0, "right.path_m": 0.9 * good.metrics["right.path_m"]}] * 2)
    said = advice(good, RULES, band)
    assert said[0] == "Reduce the time: 16 s, experts keep below 8."
    assert "path of right" in said[1]
    assert advice(good, RULES, {}) == ["Nothing stood out: do it again to be sure, then take a harder scenario."]


def test_an_attempt_that_does_not_count_says_so(erring: Assessment, good: Assessment) -> None:
    html = render(erring, RULES)
    assert "This attempt does not count: the rig broke its contracts: physics: &lt;60&gt; ticks lost." in html
    assert "does not count" not in render(good, RULES)


def test_a_report_says_each_thing_once() -> None:
    """Of a rig that is late in many ways, and of a trainee who errs in the same way again and again."""
    names = ("physics", "haptics", "gateway", "visualization", "recorder")
    said = [SupervisorState(state="degraded", reason=f"{name}: {k} ticks lost") for k in range(30) for name in names]
    late = [("supervisor.state", 1, body) for body in said]
    found = assessed(told(chain(messages(changed(ERRING)), late), 16.0))
    html = render(msgspec.structs.replace(found, errors=found.errors * 7), RULES)
    seen = re.sub(r"<(style|script|title|code|table)\b.*?</\1>", " ", html, flags=re.DOTALL)
    told_to_do = re.findall(r"<td>([^<>]*)<br>", html)
    parts = [html_text.unescape(part).strip() for part in [*told_to_do, *re.split(r"<[^>]*>|; |\. ", seen)]]
    sentences = [part for part in parts if len(part.split()) >= 5]
    assert [each for each in dict.fromkeys(sentences) if sentences.count(each) > 1] == []
    assert all(html.count(f"{name}: 0 to 29 ticks lost (said 30 times)") == 1 for name in names)
    assert len(re.sub(r"<[^>]*>", "", html[html.index("<h1>") : html.index('id="next"')]).split()) < 80


def test_marks_lead_to_three_seconds_before(erring: Assessment) -> None:
    html = render(erring, RULES, page="http://rig:8080/")
    begins = [event.begin_s for event in erring.errors]
    for at_s in begins:
        assert html.count(f'href="#replay" data-at="{at_s - 3.0:.2f}"') == 2, "the mark, and the time in the table"
        assert f'href="http://rig:8080/#replay=a.mcap&amp;at={erring.began_at_s + at_s - 3.0:.2f}"' in html
        assert f"<code>trocar replay a.mcap --pictures --from {erring.began_at_s + at_s - 3.0:.2f}</code>" in html


def test_paths_have_a_place_for_each_time(erring: Assessment) -> None:
    assert {len(path) for path in erring.series.paths_mm.values()} == {len(erring.series.time_s)}


def test_metrics_are_shown_with_unit_experts_and_the_last_attempts(good: Assessment) -> None:
    band = band_of([{"time_s": time_s} for time_s in (18.0, 20.0, 22.0)])
    html = render(good, RULES, band=band, past=past(good, [40.0, 30.0, 16.0]))
    assert '<tr><td>time<td class="n">16<td>s<td class="n">20 ± 4<td class="n">40, 30</tr>' in html
    length = f"{1e3 * good.metrics['right.path_m']:.3g}"
    assert f'<tr><td>right: path<td class="n">{length}<td>mm' in html


def test_without_experts_the_simulated_hands_are_the_measure(good: Assessment) -> None:
    html = render(msgspec.structs.replace(good, par={"time_s": 12.0, "tip.path_m": 0.031}), RULES)
    assert '<tr><td>time<td class="n">16<td>s<td class="n">par 12<td' in html
    assert 'mm<td class="n">par 31<td' in html


def test_names_from_outside_are_text(good: Assessment) -> None:
    strange = msgspec.structs.replace(good.series, paths_mm={"</script><b>": [(0.0, 0.0, 0.0)]})
    named = msgspec.structs.replace(good, title="<script>alert(1)</script>", source="</script><b>.mcap", series=strange)
    html = render(named, RULES, trainee="<i>")
    assert "<script>alert" not in html
    assert "</script><b>" not in html
    assert "<i>" not in html


def test_nothing_is_fetched(erring: Assessment) -> None:
    html = render(erring, RULES, trainee="heron-17", past=past(erring, [30.0, 20.0]))
    assert not re.search(r"(src|@import|url\()", html)
    assert set(re.findall(r'href="(http://[^/#"]*)', html)) == {"http://localhost:8080"}


def test_two_attempts_within_the_band_in_a_row_are_proficient(good: Assessment) -> None:
    band = band_of([{"time_s": time_s, "errors": 0.0} for time_s in (18.0, 20.0, 22.0)])
    verdicts = [
        re.search(r'class="badge (\w+)">([^<]*)<', render(good, RULES, band=band, past=past(good, times)))
        for times in ([40.0, 16.0], [17.0, 16.0], [16.0])
    ]
    assert [each.groups() for each in verdicts if each] == [
        ("good", "goal reached"),
        ("good", "proficient, 2 times in a row"),
        ("good", "goal reached"),
    ]


@pytest.mark.parametrize(("low", "high"), [(0.0, 1.0), (0.0, 16.0), (-3.2, 7.7), (0.0, 0.013), (5.0, 5.0)])
def test_ticks_are_few_and_within(low: float, high: float) -> None:
    found = ticks(low, high)
    assert 1 <= len(found) <= 7
    assert all(low - 1e-9 <= each <= high + 1e-9 for each in found)


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[chromium.Chromium]:
    if chromium.find() is None:
        pytest.skip("no Chromium")
    with chromium.Chromium(tmp_path_factory.mktemp("browser") / "profile") as browser:
        yield browser


def test_a_browser_draws_it_dark_and_light_and_on_a_phone(
    tmp_path: Path, erring: Assessment, browser: chromium.Chromium
) -> None:
    path = tmp_path / "report.html"
    path.write_text(render(erring, RULES, trainee="heron-17", past=past(erring, [40.0, 30.0, 25.0, 22.0, 20.0, 16.0])))
    grounds = []
    for scheme, width in (("light", 1280), ("dark", 390)):
        browser.command("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
        browser.set_size(width, 800)
        browser.open(path.as_uri())
        browser.until(lambda: browser.evaluate("document.readyState") == "complete", PATIENCE_S, "the report is there")
        assert browser.text(".badge") == "does not count"
        assert browser.evaluate("document.querySelectorAll('#timeline a').length") == len(erring.errors)
        assert browser.evaluate("document.documentElement.scrollWidth") <= width
        drawn = "pen.getImageData(0, 0, canvas.width, canvas.height).data.some(value => value > 0)"
        assert browser.evaluate(drawn)
        grounds.append(browser.evaluate("getComputedStyle(document.body).backgroundColor"))
    assert grounds == ["rgb(233, 237, 241)", "rgb(10, 12, 15)"]


def test_a_click_on_a_mark_plays_the_attempt_from_three_seconds_before(
    tmp_path: Path, erring: Assessment, browser: chromium.Chromium
) -> None:
    path = tmp_path / "report.html"
    path.write_text(render(erring, RULES))
    mark = "document.querySelector('#timeline a text').getBoundingClientRect().toJSON()"
    browser.set_size(1280, 800)
    browser.open(path.as_uri())
    browser.until(lambda: browser.evaluate("document.readyState") == "complete", PATIENCE_S, "the report is there")
    assert browser.evaluate("place") is None
    browser.evaluate(
        "globalThis.draws = []; const drawn = go; go = (to, plays) => { draws.push(to); drawn(to, plays); }"
    )
    box = browser.evaluate(mark)
    at = {
        "x": box["x"] + 0.5 * box["width"],
        "y": box["y"] + 0.5 * box["height"],
        "button": "left",
        "clickCount": 1,
    }
    for kind in ("mousePressed", "mouseReleased"):
        browser.command("Input.dispatchMouseEvent", type=kind, **at)
    began_s = erring.errors[0].begin_s - 3.0
    browser.until(lambda: browser.evaluate("draws.length > 2"), PATIENCE_S, "it plays")
    assert browser.evaluate("draws[0]") == pytest.approx(began_s, abs=0.01)
    assert browser.evaluate("place") > began_s
    assert browser.evaluate("document.getElementById('paths').getBoundingClientRect().top < innerHeight"), "in sight"
    assert " mm in" in browser.text("#where")
    browser.evaluate("document.getElementById('play').click()")
    halted = browser.evaluate("[playing, place, place]")
    assert halted[0] is False
    assert browser.evaluate("document.getElementById('play').textContent") == "Play"


def test_an_attempt_of_which_nothing_was_recorded_has_a_report_too() -> None:
    found = assessed(told(iter(()), 1.0, outcome="failure"))
    html = render(found, RULES)
    assert "not yet" in html
    assert "Bring the catheter to 12 mm within 300 s." in html
