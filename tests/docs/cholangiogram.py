"""The figure of docs/how-to/cholangiography.md: ``python -m tests.docs.cholangiogram`` draws it."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import contourpy
import numpy as np
from scipy.interpolate import CubicSpline

from trocar.review.export.cholangiogram import Cholangioscope
from trocar.services.files.cache_directory import cache_directory
from trocar.services.mechanics.arrays import Float32Array, FloatArray
from trocar.services.mechanics.scene.air_bubble import AirBubble
from trocar.services.scenes import load_duct, load_scene
from trocar.services.visualization.picture import Picture, PictureLayout

FIGURE = Path(__file__).parents[2] / "docs" / "how-to" / "cholangiogram.svg"
SIZE, ROWS, SCALE = (480, 200), slice(40, 160), 2
GREYS = -1.0, 38.5, 78.5, 98.5, 118.5, 134.5, 148.5, 165.5, 190.5, 225.5, 253.5
WORDS = (
    ("stone", 226, 232), ("bubble", 412, 40), ("common duct", 50, 40), ("catheter", 700, 40), ("neck, tied", 850, 232),
)  # fmt: skip
_LEAST_AREA = 12.0  # in square pixels of the figure, as smaller patches cannot be seen


def grey_picture() -> FloatArray:
    """Return the picture (height, width): agent has flowed for 5 s, past a stone and a bubble."""
    scene = load_scene("cholangiography")
    duct = load_duct(scene, cache_directory(), lambda _stage, _share: None)
    mesh, sets = duct.mesh, duct.mesh.vertex_sets
    rest_m, line_m = mesh.vertices_m.astype(np.float32), _line_m(mesh.vertices_m[sets["incision"]].mean(axis=0))
    mouth, clamped = tuple(sets["mouth"].tolist()), tuple(sets["clamped"].tolist())
    layout = PictureLayout(
        1, "", rest_m, mesh.triangles, scene.duct.thickness_m, mouth, clamped, len(line_m),
        0.5 * scene.catheter.outer_diameter_m, (), stone_radii_m=(1.5e-3,),
    )  # fmt: skip
    stones_m = np.array([[9e-3, 0.0, -0.9e-3]], np.float32)
    view = Cholangioscope(SIZE, frozenset({"mouth"}), [AirBubble(radius_m=0.7e-3, after_m3=1.2e-6)], (0.0, 0.0, -9.81))
    for tick in (0, 5200):
        view.update(layout, Picture(1, tick=tick, points_m=rest_m, centreline_m=line_m, stones_m=stones_m))
    grey: FloatArray = view.image()[ROWS, :, 0].astype(float)
    return grey


def _line_m(cut_m: FloatArray) -> Float32Array:
    """Return a catheter that goes in through the cut, whose middle is given, and along the duct."""
    past_m = [(22e-3, 14e-3), (1.5e-3, 0.6e-3), (-3e-3, -2e-3), (-8e-3, -1.9e-3), (-11e-3, -1.9e-3)]
    points_m = np.array([(cut_m[0] + x, 0.0, cut_m[2] + z) for x, z in past_m])
    arc_m = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points_m, axis=0), axis=1))])
    line_m: Float32Array = CubicSpline(arc_m, points_m)(np.linspace(0.0, arc_m[-1], 40)).astype(np.float32)
    return line_m


def figure(grey: FloatArray) -> str:
    """Return a picture as SVG: an area for each step of grey, and words."""
    height, width = (SCALE * each for each in grey.shape)
    areas = contourpy.contour_generator(z=grey, fill_type="OuterOffset")
    lines = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" font-family="sans-serif">']
    lines.append(f'<rect width="{width}" height="{height}" fill="#fff"/>')
    for low, high in pairwise(GREYS):
        shade = "#" + 3 * f"{round(0.5 * (max(low, 10.0) + high)):02x}"
        patches = "".join(
            _path(points[begin:end])
            for points, at in zip(*areas.filled(low, high), strict=True)
            for begin, end in pairwise(at)
        )
        lines.append(f'<path fill="{shade}" fill-rule="evenodd" d="{patches}"/>')
    lines += [f'<text x="{x}" y="{y}" font-size="16">{word}</text>' for word, x, y in WORDS]
    return "\n".join([*lines, "</svg>", ""])


def _path(outline: FloatArray) -> str:
    """Return a closed line (n, 2) on whole pixels, without points between others; nothing if it is too small."""
    points = np.round(SCALE * outline).astype(int)
    points = points[np.any(points != np.roll(points, 1, axis=0), axis=1)]
    if len(points) < 3:
        return ""
    to, on = points - np.roll(points, 1, axis=0), np.roll(points, -1, axis=0) - points
    points = points[to[:, 0] * on[:, 1] != to[:, 1] * on[:, 0]]
    x, y = points.T
    if 0.5 * abs(x @ np.roll(y, 1) - y @ np.roll(x, 1)) < _LEAST_AREA:
        return ""
    ways = " ".join(f"{dx},{dy}" for dx, dy in np.diff(points, axis=0))
    return f"M{x[0]},{y[0]}l{ways}z"


if __name__ == "__main__":
    FIGURE.write_text(figure(grey_picture()))
