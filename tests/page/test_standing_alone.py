"""Pages that stand alone, a report and a study: they look as the rig's page does, at every size, and axe is content."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import pytest

from tests import chromium
from tests.chromium import Chromium
from tests.page.looks import keep_picture, serious_faults
from tests.page.school_page import assessed
from tests.page.test_school_page import CRUSHED
from tests.patience import PATIENCE_S
from trocar.review.attempts.report import Past, render
from trocar.services.messages.page_style import page_style
from trocar.services.supervisor.page.page_place import DIST
from trocar.services.training.score import load_rules
from trocar.studies.accuracy.facts import Facts
from trocar.studies.accuracy.page import Text, write_page
from trocar.studies.accuracy.study import Cost, Draw, Row, Size

_OWN = DIST.parent / "src" / "style.css"
in_a_browser = pytest.mark.skipif(chromium.find() is None, reason="no Chromium on this machine")


def _colours(style: str) -> list[dict[str, str]]:
    """Return the colours by name of the first rules of a style sheet, dark and light."""
    blocks = [block for block in re.findall(r":root[^{]*\{([^{}]*)\}", style) if "--ground" in block]
    return [dict(re.findall(r"(--[\w-]+): (#\w+)", block)) for block in blocks]


def test_the_colours_are_those_of_the_rigs_page() -> None:
    own, alone = _colours(_OWN.read_text()), _colours(page_style())
    assert len(own) == len(alone) == 2
    for ours, theirs in zip(own, alone, strict=True):
        assert theirs.items() <= ours.items()
        assert len(theirs) > 10


def _report(folder: Path) -> Path:
    found = assessed("20261130T0-a", CRUSHED)
    metrics = {"time_s": 20.0, "deepest_m": 0.01, "grasps": 3.0, "total": 220.0}
    found = msgspec.structs.replace(found, metrics=metrics)
    past = [
        Past(began_ns=k, outcome="success", counts=True, time_s=30.0 - k, total=200.0 + k, errors=1, metrics=metrics)
        for k in range(4)
    ]
    (folder / "report.html").write_text(render(found, load_rules(), past=past, trainee="heron-17"), encoding="utf-8")
    return folder / "report.html"


def _study(folder: Path) -> Path:
    rows = [
        Row("modes", f"{n} modes", series, "force", error, "%", cost=Cost(us, 2 * us, 5.0), choices={"duct.n_modes": n})
        for series in ("residual", "none")
        for n, error, us in ((20, 3.0, 60.0), (40, 0.4, 95.0), (60, 0.05, 140.0))
    ]
    texts = {"modes": Text("modes", "How many modes a duct needs.", ["Sixty are enough."])}
    write_page(
        rows, texts, Facts.collect("trocar study modes", "abc", Draw(Size.SMALLEST, 1), {}), folder / "study.html"
    )
    return folder / "study.html"


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chromium]:
    with Chromium(tmp_path_factory.mktemp("alone") / "profile") as browser:
        yield browser


@in_a_browser
@pytest.mark.timeout(600)
@pytest.mark.parametrize("make", [_report, _study])
@pytest.mark.parametrize("scheme", ["dark", "light"])
@pytest.mark.parametrize("width", [390, 1280, 1920])
def test_nothing_is_cut_and_axe_finds_nothing(
    browser: Chromium, make: Callable[[Path], Path], scheme: str, width: int, tmp_path: Path
) -> None:
    browser.set_size(width, 900)
    browser.command("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
    browser.open(make(tmp_path).as_uri())
    browser.until(lambda: browser.evaluate("document.readyState") == "complete", PATIENCE_S, "the page is there")
    if make is _study:
        browser.evaluate("document.querySelector('circle').dispatchEvent(new MouseEvent('click', {bubbles: true}))")
    keep_picture(browser, f"alone{make.__name__}-{width}-{scheme}", whole=True)
    assert browser.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
    assert serious_faults(browser) == []
