"""The page's picture by itself: like its golden image, with what helps to judge depth and strain, and kept as files.

`python -m tests.page.test_picture` makes the golden image anew; look at it before it is committed.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests import chromium
from tests.chromium import Chromium
from tests.page.served_picture import drawn, served
from tests.patience import PATIENCE_S
from tests.visualization.likeness import Pixels, likeness, mean_likeness, picture
from tests.visualization.test_render import a_scene
from trocar.services.supervisor.page.page_place import DIST
from trocar.services.visualization.picture import Picture, PictureLayout

pytestmark = [
    pytest.mark.timeout(600),
    pytest.mark.skipif(chromium.find() is None, reason="no Chromium on this machine"),
    pytest.mark.skipif(not (DIST / "index.html").is_file(), reason="the page is not built"),
]

GOLDEN = Path(__file__).parent / "golden" / "page.png"
SIZE = (384, 178)
#: The same picture by another driver is more like it than this, one without its catheter or shadows less.
LIKE = 0.95
#: Where the top of the duct below the tool is in the picture: down and across, as shares.
_FOOT = """(() => {
  const {stage, canvas} = trocar.view, at = stage.pixelOf([20, 0, 4]), box = canvas.getBoundingClientRect();
  return [(at.y - box.top) / box.height, (at.x - box.left) / box.width];
})()"""


def still() -> tuple[PictureLayout, Picture]:
    """Return a duct that is stretched at one end, a catheter in it, and a tool that comes down on it."""
    layout, shown = a_scene()
    x = layout.rest_m[:, 0]
    ends = {"mouth": x > x.max() - 1e-6, "clamped": x < x.min() + 1e-6}
    layout = replace(layout, **{name: tuple(np.flatnonzero(there).tolist()) for name, there in ends.items()})
    stretched, poses = shown.points_m.copy(), shown.poses.copy()
    stretched[:, 2] *= np.where(x < 0.02, 1.15, 1.0)
    poses[0, 2] = 0.035
    return layout, replace(shown, points_m=stretched, poses=poses)


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chromium]:
    with served(tmp_path_factory.mktemp("picture"), *still()) as browser:
        yield browser


def _seen(page: Chromium) -> Pixels:
    return picture(drawn(page), SIZE)


def _press(page: Chromium, name: str) -> None:
    page.evaluate(f"document.getElementById('{name}').click()")


def test_the_picture_is_like_its_golden_image(page: Chromium) -> None:
    assert mean_likeness(_seen(page), picture(GOLDEN.read_bytes(), SIZE)) > LIKE


@pytest.mark.parametrize("without", ["catheter.object", "tools[0].object", "duct.object"])
def test_a_picture_that_lacks_a_body_is_not_like_it(page: Chromium, without: str) -> None:
    golden = picture(GOLDEN.read_bytes(), SIZE)
    page.evaluate(f"trocar.view.stage.{without}.visible = false")
    try:
        assert likeness(_seen(page), golden).min() < 0.5
    finally:
        page.evaluate(f"trocar.view.stage.{without}.visible = true")


def test_a_ring_shows_where_a_tool_would_meet_the_wall(page: Chromium) -> None:
    with_ring = _seen(page)
    _press(page, "aim")
    without = _seen(page)
    _press(page, "aim")
    changed = np.argwhere(np.abs(with_ring - without).max(axis=2) > 15.0)
    assert 10 < len(changed) < 0.02 * with_ring[..., 0].size
    # It is on the wall below the tool: between the jaws' picture above and the duct's lower edge.
    box = page.evaluate(_FOOT)
    middle = changed.mean(axis=0) / np.array(with_ring.shape[:2])
    np.testing.assert_allclose(middle, box, atol=0.05)


def test_strain_is_shown_on_demand_with_its_scale(page: Chromium) -> None:
    flesh = _seen(page)
    _press(page, "strain")
    coloured = _seen(page)
    assert page.evaluate("!document.getElementById('strain-scale').hidden")
    _press(page, "strain")
    blue = coloured[..., 2] - coloured[..., 0]
    assert (blue > 30.0).sum() > 200
    assert (flesh[..., 2] - flesh[..., 0] > 30.0).sum() == 0
    assert mean_likeness(_seen(page), flesh) > LIKE


@pytest.mark.parametrize(("presses", "kind", "begins"), [(1, "png", b"\x89PNG"), (2, "webm", b"\x1aE\xdf\xa3")])
def test_the_view_is_kept_in_a_file(page: Chromium, presses: int, kind: str, begins: bytes, tmp_path: Path) -> None:
    """A picture, or a film between two presses, however short: as a browser lets the page of a rig save it."""
    page.command("Page.setDownloadBehavior", behavior="allow", downloadPath=str(tmp_path))
    for _ in range(presses):
        _press(page, "keep-picture" if kind == "png" else "keep-film")
    # It is there, and empty, before a browser has written it.
    files = lambda: list(tmp_path.glob(f"trocar-*.{kind}"))  # noqa: E731
    page.until(lambda: any(each.read_bytes().startswith(begins) for each in files()), PATIENCE_S, "a file of its kind")
    if kind == "png":
        data = files()[0].read_bytes()
        assert mean_likeness(picture(data, SIZE), picture(GOLDEN.read_bytes(), SIZE)) > LIKE


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder, served(Path(folder), *still()) as browser:
        from PIL import Image

        GOLDEN.parent.mkdir(exist_ok=True)
        Image.fromarray(picture(drawn(browser), SIZE).round().astype(np.uint8)).save(GOLDEN, optimize=True)
