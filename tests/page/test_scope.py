"""The scope that a person steers at the page: its picture is the one that a lens at its place has, and it obeys."""

from __future__ import annotations

import io
import itertools
import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from tests import chromium
from tests.chromium import Chromium
from tests.page.served_picture import drawn, served
from tests.page.test_picture import still
from tests.patience import PATIENCE_S
from trocar.services.supervisor.page.page_place import DIST

pytestmark = [
    pytest.mark.timeout(600),
    pytest.mark.skipif(chromium.find() is None, reason="no Chromium on this machine"),
    pytest.mark.skipif(not (DIST / "index.html").is_file(), reason="the page is not built"),
]
Array = NDArray[np.float64]
#: Middles of stones that float about the duct, not in one plane, in mm.
STONES = np.array([[40.0, -9.0, 10.0], [30.0, 10.0, 14.0], [12.0, -2.0, 12.0]])
#: Swing to the right and up, turn of the lens, and way in: straight, aside, about, and all at once.
POSES = [
    (0.0, 0.0, 0.0, 0.0), (0.12, -0.08, 0.0, 5.0), (0.05, 0.1, 0.5, -20.0), (-0.2, 0.3, -0.9, -30.0),
    (-0.1, 0.55, math.pi, -40.0),
]  # fmt: skip
_POSE = """((swung, turned, further) => {
  const {stage} = trocar.view, {scope} = stage;
  start ??= scope.depth;
  Object.assign(scope, {swung, turned, depth: start + further});
  stage.placeScope();
})"""
_SCOPE = "(({port, shaft, above, depth, swung, turned}) => ({port, shaft, above, depth, swung, turned}))"


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chromium]:
    layout, shown = still()
    layout = replace(layout, stone_radii_m=(1.5e-3,) * len(STONES))
    shown = replace(shown, stones_m=(1e-3 * STONES).astype(np.float32))
    shown.poses[0, :3] = 0.0, 0.06, 0.08  # no tool before a stone
    with served(tmp_path_factory.mktemp("scope"), layout, shown) as browser:
        browser.evaluate("globalThis.start = null")
        browser.evaluate("trocar.view.stage.tools.forEach((tool) => (tool.object.scale.setScalar(0)))")
        yield browser


def _hold(page: Chromium, *, on: bool = True) -> None:
    if page.evaluate("Boolean(trocar.view.stage.scope)") != on:
        page.evaluate("document.getElementById('steer').click()")


def _set(page: Chromium, right: float, up: float, turned: float, further: float) -> dict[str, Any]:
    """Hold the scope so; return how it says that it is held."""
    _hold(page)
    page.evaluate(f"{_POSE}([{right}, {up}], {turned}, {further})")
    scope: dict[str, Any] = page.evaluate(f"{_SCOPE}(trocar.view.stage.scope)")
    return scope


def _seen(scope: dict[str, Any], points: Array, width: float, height: float) -> Array:
    """Return where points (n, 3) are in a picture, in pixels to the right and down; not a number behind the lens.

    The shaft comes from its port; the lens looks 30 degrees aside of it. What the shaft's direction s has as its upper
    side, the picture has after the least turn from s to the look f: v - (s + f) ((s + f) v) / (1 + s f) + 2 f (s v).
    """
    first, above = np.array(scope["shaft"]), np.array(scope["above"])
    x, y = scope["swung"]
    s = first + x * np.cross(first, above) + y * above
    s /= np.linalg.norm(s)
    upper = above - (above @ s) * s
    upper /= np.linalg.norm(upper)
    aside = math.cos(scope["turned"]) * upper + math.sin(scope["turned"]) * np.cross(s, upper)
    f = math.cos(math.pi / 6) * s + math.sin(math.pi / 6) * aside
    up = upper - (s + f) * ((s + f) @ upper) / (1.0 + s @ f) + 2.0 * f * (s @ upper)
    from_eye = points - (np.array(scope["port"]) + scope["depth"] * s)
    ahead = from_eye @ f
    share = np.stack([from_eye @ np.cross(f, up), -from_eye @ up], axis=1) / ahead[:, None]
    pixels = 0.5 * np.array([width, height]) + share * 0.5 * height / math.tan(math.radians(25.0))
    return np.where(ahead[:, None] > 0.0, pixels, np.nan)


def _box(page: Chromium) -> tuple[float, float, float, float]:
    said = page.evaluate(
        "(({left, top, width, height}) => [left, top, width, height])(trocar.view.canvas.getBoundingClientRect())"
    )
    left, top, width, height = said
    return left, top, width, height


@pytest.mark.parametrize("pose", POSES, ids=str)
def test_points_are_in_the_picture_where_a_lens_at_its_place_has_them(
    page: Chromium, pose: tuple[float, float, float, float]
) -> None:
    scope = _set(page, *pose)
    left, top, width, height = _box(page)
    points = np.array([[0.0, 0.0, 0.0], [40.0, 3.5, 0.0], [20.0, -3.5, 1.0], *STONES])
    said = page.evaluate(
        f"{points.tolist()}.map((point) => trocar.view.stage.pixelOf(point)).map(({{x, y}}) => [x, y])"
    )
    expected = _seen(scope, points, width, height) + np.array([left, top])
    assert np.isfinite(expected).all()
    # The page draws whole pixels: up to half a pixel of the height is missing, and as much for the width.
    np.testing.assert_allclose(said, expected, atol=0.5)


@pytest.mark.parametrize(("turned", "further"), [(0.0, 0.0), (0.5, -15.0), (-0.9, -30.0), (math.pi, -10.0)])
def test_what_is_drawn_is_there_and_not_its_mirror_image(page: Chromium, turned: float, further: float) -> None:
    """Each stone by the pixels that change with it, with the lens turned, and swung so that the stones are seen."""
    scope = _set(page, *_swing_to_stones(page, turned, further), turned, further)
    whole = _pixels(drawn(page))
    height, width, _ = whole.shape
    expected, middle = _seen(scope, STONES, width, height), 0.5 * np.array([width, height])
    assert (np.linalg.norm(expected - middle, axis=1) < 0.5 * height).all()  # in the round picture
    found = np.array([_where(whole, _without(page, i)) for i in range(len(STONES))])
    np.testing.assert_allclose(found, expected, atol=3.0)
    assert np.abs(found - (np.array([width, 0.0]) + [-1.0, 1.0] * expected)).max() > 20.0


def _swing_to_stones(page: Chromium, turned: float, further: float) -> tuple[float, float]:
    """Return the swing, within 45 degrees, with which the stones are most in the middle of the picture."""
    scope = _set(page, 0.0, 0.0, turned, further)
    swings = itertools.product(np.linspace(-1.0, 1.0, 41).tolist(), repeat=2)
    off = {swing: np.abs(_seen(scope | {"swung": swing}, STONES, 1.0, 1.0) - 0.5).max() for swing in swings}
    return min((swing for swing in off if np.isfinite(off[swing])), key=off.__getitem__)


def _without(page: Chromium, i: int) -> Array:
    page.evaluate(f"trocar.view.stage.stones[{i}].object.visible = false")
    try:
        return _pixels(drawn(page))
    finally:
        page.evaluate(f"trocar.view.stage.stones[{i}].object.visible = true")


def _pixels(png: bytes) -> Array:
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"), float)


def _where(whole: Array, without: Array) -> Array:
    """Return the middle of what has changed most between two pictures, to the right and down: no shadow."""
    changed = np.abs(whole - without).max(axis=2)
    rows, columns = np.nonzero(changed > 0.5 * changed.max())
    return np.array([np.median(columns), np.median(rows)])


def test_three_points_turn_the_way_round_that_they_do_in_the_world(page: Chromium) -> None:
    """From above, whichever way the lens is turned; with the mirror, the other way."""
    a, b, c = STONES
    from_above = math.copysign(1.0, np.cross(b - a, c - a)[2])
    for pose, mirrored in itertools.product(POSES[:3], (False, True)):
        _set(page, *pose)
        page.evaluate(f"trocar.view.setMirrored({str(mirrored).lower()})")
        try:
            p, q, r = np.array(page.evaluate(
                f"{STONES.tolist()}.map((point) => trocar.view.stage.pixelOf(point)).map(({{x, y}}) => [x, -y])"
            ))  # fmt: skip
        finally:
            page.evaluate("trocar.view.setMirrored(false)")
        turn = (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])
        assert math.copysign(1.0, turn) == from_above * (-1.0 if mirrored else 1.0)


def _eye(page: Chromium) -> Array:
    return np.array(page.evaluate("trocar.view.stage.camera.position.toArray()"))


def _key(page: Chromium, code: str, kind: str) -> None:
    page.evaluate(f"dispatchEvent(new KeyboardEvent('{kind}', {{code: '{code}'}}))")


@pytest.mark.parametrize(("code", "moves"), [("ArrowRight", "right"), ("ArrowUp", "up"), ("KeyW", "forward")])
def test_keys_move_its_tip_as_the_person_sees_it(page: Chromium, code: str, moves: str) -> None:
    _set(page, 0.0, 0.0, 0.0, -20.0)
    before, ways = _eye(page), page.evaluate("trocar.view.stage.scope.look()")
    _key(page, code, "keydown")
    page.until(lambda: np.linalg.norm(_eye(page) - before) > 1.0, PATIENCE_S, "the tip has moved")
    _key(page, code, "keyup")
    assert (_eye(page) - before) @ np.array(ways[moves]) > 0.5


def test_what_is_looked_at_follows_the_mouse(page: Chromium) -> None:
    _set(page, 0.0, 0.0, 0.0, -20.0)
    left, top, width, height = _box(page)
    x, y = left + 0.5 * width, top + 0.4 * height
    page.evaluate("globalThis.looked = trocar.view.stage.controls.target.clone()")
    at = "(({x, y}) => [x, y])(trocar.view.stage.pixelOf(looked.toArray()))"
    before = np.array(page.evaluate(at))
    for kind, dx in (("mousePressed", 0), ("mouseMoved", 10), ("mouseMoved", 50), ("mouseReleased", 50)):
        page.command(
            "Input.dispatchMouseEvent", type=kind, x=x + dx, y=y + 0.4 * dx, button="left", buttons=1, clickCount=1
        )  # fmt: skip
    page.until(lambda: np.linalg.norm(page.evaluate(at) - before) > 30.0, PATIENCE_S, "the picture has moved")
    np.testing.assert_allclose(page.evaluate(at) - before, [50.0, 20.0], atol=6.0)  # to first order


def test_who_takes_the_scope_sees_what_was_there_and_who_lets_go_looks_level(page: Chromium) -> None:
    _hold(page, on=False)
    page.evaluate("document.querySelector('[data-preset=scope]').click()")
    before = _eye(page)
    _key(page, "Digit3", "keydown")
    assert page.evaluate("document.getElementById('steer').getAttribute('aria-pressed')") == "true"
    assert not page.evaluate("document.getElementById('scope-hint').hidden")
    np.testing.assert_allclose(_eye(page), before, atol=1e-6)
    _set(page, 0.1, 0.1, 1.0, -10.0)
    held = _eye(page)
    page.evaluate("document.querySelector('[data-preset=side]').click()")
    assert not page.evaluate("Boolean(trocar.view.stage.scope)")
    assert page.evaluate("document.getElementById('scope-hint').hidden")
    up = page.evaluate("trocar.view.stage.camera.matrixWorld.elements.slice(0, 3)")  # its right side
    assert abs(up[2]) < 1e-6
    _hold(page)
    np.testing.assert_allclose(_eye(page), held, atol=1e-6)  # where it was left
    page.evaluate("document.querySelector('[data-preset=scope]').click()")
    np.testing.assert_allclose(_eye(page), before, atol=1e-6)  # and at its start again
