"""What is in the picture of the native window, and what its keys change: one window, seen on a virtual display."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from tests.visualization.test_window import JUNCTIONS, PORTS, Display, a_scene, open_window, pytestmark, until
from trocar.services.visualization import cameras
from trocar.services.visualization.picture import Picture, PictureLayout
from trocar.services.visualization.window import WindowOutput

__all__ = ["pytestmark"]


@dataclass(frozen=True)
class Seen:
    """A window that several tests look at, each of which leaves it as it was: who draws takes seconds to be there."""

    window: WindowOutput
    display: Display


@pytest.fixture(scope="module")
def seen(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Seen]:
    display = Display(tmp_path_factory.mktemp("seen"))
    try:
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("DISPLAY", display.name)
            window = open_window()
        with closing(window):
            yield Seen(window, display)
    finally:
        display.end()


def seen_at(point_m: object, layout: PictureLayout, size: tuple[int, int]) -> tuple[int, int]:
    """Return the pixel (row, column) in which a camera at the page's first place sees a point: pinhole, 50 degrees."""
    place = cameras.place(layout, "scope")
    ahead = place.aim_m - place.position_m
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    away = np.asarray(point_m) - place.position_m
    width, height = size
    focal = 0.5 * height / np.tan(np.radians(25.0))
    column = 0.5 * width + focal * (away @ right) / (away @ ahead)
    row = 0.5 * height - focal * (away @ np.cross(right, ahead)) / (away @ ahead)
    return round(row), round(column)


def colour_at(point_m: object, layout: PictureLayout, picture: np.ndarray) -> np.ndarray:
    """Return the median colour of the 3 by 3 pixels where a point is seen."""
    height, width = picture.shape[:2]
    row, column = seen_at(point_m, layout, (width, height))
    return np.median(picture[row - 1 : row + 2, column - 1 : column + 2].reshape(-1, 3), axis=0)


def missing(layout: PictureLayout, seen: np.ndarray) -> str:
    """Return what is not in a picture where it should be, empty where all is."""
    red, green, blue = colour_at([0.017, -0.002, 3.6e-3], layout, seen)
    if not (red > 90 and green < 0.75 * red and abs(green - blue) < 0.3 * red):
        return f"duct: {red, green, blue}"
    red, green, blue = colour_at([0.0465, 0.0, 0.0022], layout, seen)
    if not (red > 100 and 0.6 * red < green < 0.9 * red and blue < 0.5 * red):
        return f"catheter: {red, green, blue}"
    for name, port_m in PORTS.items():
        at = np.array(JUNCTIONS[name])
        along = (at - port_m) / np.linalg.norm(at - port_m)
        sleeve, clevis = (colour_at(at + place_m * along, layout, seen) for place_m in (-0.013, -0.004))
        if max(np.ptp(sleeve), np.ptp(clevis)) > 30 or sleeve.max() > 90 or clevis.min() < sleeve.max() + 15:
            return f"dark sleeve and steel of the {name} tool: {sleeve}, {clevis}"
    red, green, blue = colour_at([0.02, 0.02, -0.02], layout, seen)
    return "" if red > 15 and red > 1.5 * green else f"the liver's bed: {red, green, blue}"


@contextmanager
def without_lens(seen: Seen, layout: PictureLayout, picture: Picture) -> Iterator[None]:
    """Take the lens away until everything is seen, as its edge is in the way of some; put it back at the end."""
    window, display = seen.window, seen.display
    until(window, lambda: window.gauges()["window_pictures"] > 0, picture, layout)
    display.press("l")
    until(window, lambda: not missing(layout, display.window()), picture, layout)
    yield
    display.press("l")


def test_duct_catheter_and_both_tools_are_in_the_picture(seen: Seen) -> None:
    layout, picture = a_scene()
    picture.force_n[:] = 0.0  # no arrows over what is looked for
    with without_lens(seen, layout, picture):
        if os.environ.get("TROCAR_KEEP_PICTURES"):
            from PIL import Image

            place = Path(os.environ["TROCAR_KEEP_PICTURES"]) / "window.png"
            Image.fromarray(seen.display.window().astype(np.uint8)).save(place)


def test_the_lens_darkens_what_is_beside_it_and_keys_move_the_camera(seen: Seen) -> None:
    window, display = seen.window, seen.display
    layout, picture = a_scene()
    picture.force_n[:] = 0.0

    def beside() -> np.ndarray:
        shown = display.window()
        return shown[len(shown) // 3 : len(shown) // 2, 2 : max(3, shown.shape[1] // 40)]  # no text is there

    until(window, lambda: not missing(layout, display.window()) and beside().max() < 12, picture, layout)
    display.press("l")
    until(window, lambda: beside().max() > 20, picture, layout)
    display.press("3")
    until(window, lambda: bool(missing(layout, display.window())), picture, layout)
    display.press("1")
    until(window, lambda: not missing(layout, display.window()), picture, layout)
    display.press("l")


def test_the_mirrored_picture_is_as_bright_as_the_other(seen: Seen) -> None:
    window, display = seen.window, seen.display
    layout, picture = a_scene()

    def in_the_mirror() -> np.ndarray:
        return display.window()[:, ::-1]

    with without_lens(seen, layout, picture):
        display.press("m")
        until(window, lambda: not missing(layout, in_the_mirror()), picture, layout)
        display.press("m")
        until(window, lambda: not missing(layout, display.window()), picture, layout)


def test_the_scales_are_there_while_the_duct_is_coloured(seen: Seen) -> None:
    """One below the other: red, yellow, blue of the stretch, red, amber, green of the force."""
    window, display = seen.window, seen.display
    layout, picture = a_scene()
    shades = [(219, 41, 31), (252, 230, 38), (41, 51, 107), (240, 105, 90), (234, 181, 77), (103, 209, 189)]

    def order() -> list[int]:
        shown = display.window()
        bar = shown[:, round(0.915 * shown.shape[1])]
        away = np.abs(bar[:, None] - np.array(shades, float)).max(axis=2)
        return [int(away[:, k].argmin()) if away[:, k].min() < 12 else -1 for k in range(len(shades))]

    until(window, lambda: window.gauges()["window_pictures"] > 0, picture, layout)
    assert max(order()) == -1
    display.press("s")
    until(window, lambda: min(found := order()) >= 0 and found == sorted(found), picture, layout)
    display.press("s")
    until(window, lambda: max(order()) == -1, picture, layout)
