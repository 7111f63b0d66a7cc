"""The native picture is like its golden image, whatever driver draws it; what lacks a body is not.

`python -m tests.visualization.test_golden_picture` makes the golden image anew; look at it before it is committed.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.visualization.likeness import Pixels, likeness, mean_likeness, picture
from tests.visualization.test_render import a_scene, pytestmark, render
from trocar.services.visualization import codec
from trocar.services.visualization.picture import Picture, PictureLayout
from trocar.services.visualization.render_pipe import FRAME, HELLO, RENDER, pack

__all__ = ["pytestmark"]
GOLDEN = Path(__file__).parent / "golden" / "native.png"
LIKE, UNLIKE = 0.95, 0.5


def _drawn(layout: PictureLayout, *shown: Picture) -> list[bytes]:
    hello = pack(HELLO, codec.encode_hello(layout).encode())
    frames = [part for each in shown for part in (pack(FRAME, codec.encode(each, 0)), pack(RENDER, b"png"))]
    return render(hello, *frames)


def _still() -> tuple[PictureLayout, Picture]:
    layout, shown = a_scene()
    return layout, replace(shown, force_n=np.array([[0.1, 0.0, 0.3]], np.float32))


@pytest.fixture(scope="module")
def drawn() -> list[Pixels]:
    """Return the whole picture, those that lack catheter, tool, duct or arrow, and one without tool and arrow."""
    layout, shown = _still()
    away, no_force_n = np.array([0.0, 0.0, 1.0], np.float32), np.zeros((1, 3), np.float32)
    without_tool = replace(shown, poses=shown.poses + np.append(away, [0, 0, 0, 0]).astype(np.float32))
    lacking = [
        replace(shown, centreline_m=shown.centreline_m + away),
        without_tool,
        replace(shown, points_m=shown.points_m + away),
        replace(shown, force_n=no_force_n),
        replace(without_tool, force_n=no_force_n),
    ]
    return [picture(each) for each in _drawn(layout, shown, *lacking)]


def test_the_native_picture_is_like_its_golden_image_and_one_that_lacks_a_body_is_not(drawn: list[Pixels]) -> None:
    golden = picture(GOLDEN.read_bytes())
    whole, *without, _ = drawn
    assert mean_likeness(whole, golden) > LIKE
    assert [each for each in without if likeness(each, golden).min() > UNLIKE] == []


def test_a_tool_casts_its_shadow_on_the_wall_and_the_bed(drawn: list[Pixels]) -> None:
    """Places where a tool was not seen, and flesh was, are brighter once it is gone."""
    with_tool, without = drawn[0], drawn[-1]
    red, green, _ = np.moveaxis(with_tool, 2, 0)
    shaded = (without[..., 0] - red > 8.0) & (red > 1.5 * green)
    wall = without[..., 0] > 110.0
    assert (shaded & wall).sum() > 20
    assert (shaded & ~wall).sum() > 50


if __name__ == "__main__":
    from PIL import Image

    GOLDEN.parent.mkdir(exist_ok=True)
    pixels = picture(_drawn(*_still())[0])
    Image.fromarray(pixels.round().astype(np.uint8)).save(GOLDEN, optimize=True)
