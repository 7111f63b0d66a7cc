"""The page in a browser: clicks make an end the mouth, or held, and set the goal; all of it is saved."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

from tests import chromium
from tests.anatomy.phantoms import forked, scan
from tests.anatomy.volumes import write_volume
from tests.page.looks import Look, cut_words, keep_picture, looked_at, serious_faults
from tests.patience import PATIENCE_S
from trocar.services.anatomy.edit_page import EditPage
from trocar.services.anatomy.making import AnatomyRequest, MadeAnatomy, make_anatomy
from trocar.services.supervisor.page.page_place import DIST

pytest.importorskip("SimpleITK", reason="the scan extra is not installed")

_PIXEL = """(() => {
  const {stage} = trocar, box = stage.canvas.getBoundingClientRect();
  const at = stage.controls.target.clone().set(%f, %f, %f).project(stage.camera);
  return [box.left + (at.x + 1) / 2 * box.width, box.top + (1 - at.y) / 2 * box.height];
})()"""


def click(browser: chromium.Chromium, place_mm: list[float]) -> None:
    x, y = browser.evaluate(_PIXEL % tuple(place_mm))
    for kind in ("mousePressed", "mouseReleased"):
        browser.command("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)


def choose(browser: chromium.Chromium, tool: str) -> None:
    browser.evaluate(f"""document.querySelector('input[value="{tool}"]').click()""")


def look_at(browser: chromium.Chromium) -> None:
    """Look at the page on a phone, at a desk and on a projector, dark and light."""
    for look in (
        Look(scheme, *size) for scheme in ("light", "dark") for size in ((390, 844), (1280, 800), (1920, 1080))
    ):
        with looked_at(browser, look):
            keep_picture(browser, f"anatomy-{look}")
            assert browser.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0, look
            assert cut_words(browser) == [], look
            assert serious_faults(browser) == [], look


@pytest.mark.skipif(chromium.find() is None, reason="needs Chromium")
@pytest.mark.skipif(not (DIST / "anatomy.html").is_file(), reason="needs the built page")
def test_clicks_are_picks(tmp_path: Path) -> None:
    made = make_anatomy(write_volume(scan(forked(), (0.8, 0.8, 0.8)), tmp_path / "duct.nrrd"), AnatomyRequest())
    saved: list[MadeAnatomy] = []
    page, addresses = EditPage(made, saved.append, DIST), list[str]()
    serving = threading.Thread(target=page.serve, args=(0, addresses.append))
    serving.start()
    try:
        with chromium.Chromium(tmp_path / "profile") as browser:
            browser.until(lambda: addresses, PATIENCE_S, "an address")
            browser.open(addresses[0])
            browser.until(lambda: browser.evaluate("Boolean(globalThis.trocar?.duct)"), PATIENCE_S, "the duct")
            first, second, old = made.duct.ends
            choose(browser, "mouth")
            click(browser, (1e3 * first.opening.centre_m).tolist())
            assert browser.evaluate("trocar.picks.mouth") == first.name
            assert sorted(browser.evaluate("[...trocar.picks.held]")) == sorted([second.name, old.name])
            choose(browser, "held")
            click(browser, (1e3 * second.opening.centre_m).tolist())
            choose(browser, "goal")
            line = made.duct.lines[0].points_m
            click(browser, (1e3 * line[len(line) // 2]).tolist())
            look_at(browser)
            browser.evaluate("document.getElementById('save').click()")
            browser.until(lambda: browser.text("#said") == "Saved.", PATIENCE_S, "the save")
            assert (saved[-1].choice.mouth, saved[-1].choice.held) == (first.name, (old.name,))
            assert saved[-1].goal is not None
            browser.evaluate("document.getElementById('end').click()")
            serving.join(PATIENCE_S)
            assert not serving.is_alive()
    finally:
        page.end()
        serving.join(PATIENCE_S)
