"""The eye at the page: the jaws of both instruments and the mouth are in the picture, with a margin, uncovered."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tests import chromium
from tests.chromium import Chromium
from tests.page.served_picture import served
from tests.page.test_picture import still
from tests.patience import PATIENCE_S
from trocar.services.supervisor.page.page_place import DIST
from trocar.services.visualization.picture import Picture, PictureLayout

pytestmark = [
    pytest.mark.timeout(600),
    pytest.mark.skipif(chromium.find() is None, reason="no Chromium on this machine"),
    pytest.mark.skipif(not (DIST / "index.html").is_file(), reason="the page is not built"),
]
Point = tuple[float, float, float]
_SIZES = [(390, 844), (844, 390), (800, 560), (1280, 800), (1920, 1080)]
_ATTEMPT = Path(__file__).with_name("attempt_layout.js").read_text(encoding="utf-8")
#: Of each point that must be seen: how far it is from the picture's edge, as a share of its shorter side, and what
#: words of the page lie over it.
_SEEN = """(() => {
  const {stage, last} = trocar.view, view = document.getElementById('view').getBoundingClientRect();
  const jaws = stage.layout.tools.flatMap(({port, jawLength}, i) => {
    const j = [...last.poses.subarray(7 * i, 7 * i + 3)], away = j.map((x, k) => x - port[k]);
    return [j, j.map((x, k) => x + jawLength * away[k] / Math.hypot(...away))];
  });
  const boxes = [...document.querySelectorAll('#attempt, #tools li, .hud.bottom button, #hands p')];
  const over = ({x, y}) => boxes.find((box) => {
    const {left, right, top, bottom, width} = box.getBoundingClientRect();
    return width && x > left && x < right && y > top && y < bottom;
  });
  return [stage.mouth.toArray(), ...jaws].map((point) => {
    const at = stage.pixelOf(point), half = 0.5 * Math.min(view.width, view.height);
    const across = half - Math.abs(at.x - view.left - 0.5 * view.width), covering = over(at);
    const margin = Math.min(across, at.y - view.top, view.bottom - at.y) / (2 * half);
    return [margin, covering ? covering.id || covering.textContent : ''];
  });
})()"""


def two_tools() -> tuple[PictureLayout, Picture]:
    """Return a duct and a catheter between the two forceps of the default scene, which stand high above."""
    layout, shown = still()
    (tool,) = layout.tools
    ports = {"left": (0.075, -0.06, 0.12), "right": (0.01, 0.07, 0.11)}
    tools = tuple(replace(tool, name=name, port_m=port, jaw_length_m=0.02) for name, port in ports.items())
    at = {"left": (0.066, -0.012, 0.03), "right": (0.02, 0.014, 0.032)}
    poses = np.array([[*at[each.name], *_towards(ports[each.name], at[each.name])] for each in tools], np.float32)
    forces, jaws = np.zeros((2, 3), np.float32), np.array([0.4, 0.4], np.float32)
    return replace(layout, tools=tools), replace(shown, poses=poses, force_n=forces, jaw_rad=jaws)


def _towards(port: Point, junction: Point) -> NDArray[np.float64]:
    """Return the quaternion (wxyz) that turns x from the port to the junction."""
    way = np.subtract(junction, port)
    way /= np.linalg.norm(way)
    turn = np.array([1.0 + way[0], *np.cross([1.0, 0.0, 0.0], way)])
    return np.asarray(turn / np.linalg.norm(turn))


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chromium]:
    with served(tmp_path_factory.mktemp("camera"), *two_tools()) as browser:
        browser.evaluate(f"{_ATTEMPT};document.getElementById('hands').hidden = false")
        yield browser


def _show(page: Chromium, size: tuple[int, int], face: str) -> None:
    page.set_size(*size)
    page.evaluate(f"location.hash = 'face={face}'")
    page.until(lambda: page.evaluate("innerWidth") == size[0], PATIENCE_S, "the size was taken")
    page.until(lambda: page.evaluate("document.body.dataset.face") == face, PATIENCE_S, "the hash was heard")
    page.evaluate("layout.tell()")
    page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")


@pytest.mark.parametrize("face", ["trainee", "engineer"])
@pytest.mark.parametrize("size", _SIZES, ids=str)
def test_jaws_and_mouth_are_seen_with_a_margin_and_uncovered(page: Chromium, size: tuple[int, int], face: str) -> None:
    _show(page, size, face)
    is_wide_open = size != (844, 390)  # where the page's panels leave no room, the whole picture is used
    for margin, over in page.evaluate(_SEEN):
        assert margin > 0.02, "of the picture's shorter side"
        assert not (is_wide_open and over)


def test_who_has_turned_the_view_keeps_it_when_the_window_changes(page: Chromium) -> None:
    _show(page, (1280, 800), "trainee")
    page.evaluate("trocar.view.stage.controls.dispatchEvent({type: 'start'})")
    before = page.evaluate("trocar.view.stage.camera.position.toArray()")
    _show(page, (800, 560), "trainee")
    assert page.evaluate("trocar.view.stage.camera.position.toArray()") == pytest.approx(before, abs=1e-3)
    page.evaluate("document.querySelector('[data-preset=scope]').click()")
    assert all(margin > 0.02 for margin, _ in page.evaluate(_SEEN))


def test_a_picture_does_not_jump_under_a_hand(page: Chromium) -> None:
    _show(page, (1280, 800), "trainee")
    page.evaluate("trocar.hands.show(true)")
    try:
        page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
        before = page.evaluate("trocar.view.stage.camera.position.toArray()")
        page.evaluate("document.getElementById('attempt-hint').textContent = 'Many words. '.repeat(60)")
        page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
        assert page.evaluate("trocar.view.stage.camera.position.toArray()") == pytest.approx(before, abs=1e-3)
    finally:
        page.evaluate("trocar.hands.show(false); layout.tell()")
