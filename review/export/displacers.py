"""What displaces contrast agent in a lumen: segments of the catheter and its wire, stones and bubbles, as volumes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trocar.review.export.fluoroscopy import rod
from trocar.services.mechanics.arrays import Float32Array, FloatArray, IntArray
from trocar.services.visualization.picture import Picture, PictureLayout

_SAMPLE_M = 0.2e-3
"""Distance of the places that stand for a body in the cells: a third of a cell's length."""
_RINGS = 24
"""Of a drawn ball: a ray's way through it differs from a ball's by 1 - cos(pi / 48), 0.2 %."""


@dataclass(frozen=True)
class Displacer:
    """A body that is in the lumen as a whole or not at all, as its middle (3,) is, with its closed surface.

    Places (k, 3) share its volume and its wetted area alike. ``ball_radius_m`` is zero of what is no ball.
    """

    middle_m: FloatArray
    places_m: FloatArray
    volume_m3: float
    area_m2: float
    surface_m: Float32Array
    triangles: IntArray
    ball_radius_m: float = 0.0


def displacers(layout: PictureLayout, picture: Picture) -> list[Displacer]:
    """Return the segments of catheter and wire, and behind them the stones."""
    line_m = picture.centreline_m.astype(float)
    bodies = [
        _segment(ends_m, radius_m)
        for part, radius_m in layout.rods()
        for ends_m in np.lib.stride_tricks.sliding_window_view(line_m[part], 2, axis=0).transpose(0, 2, 1)
    ]
    balls = zip(picture.stones_m.astype(float), layout.stone_radii_m, strict=False)
    return bodies + [ball(middle_m, radius_m) for middle_m, radius_m in balls]


def ball(middle_m: FloatArray, radius_m: float) -> Displacer:
    """Return a stone or a bubble."""
    count = int(np.ceil(2.0 * radius_m / _SAMPLE_M))
    across = (2.0 * np.arange(count) + 1.0) / count - 1.0
    lattice = np.stack(np.meshgrid(across, across, across, indexing="ij"), axis=-1).reshape(-1, 3)
    places_m = middle_m + radius_m * lattice[np.linalg.norm(lattice, axis=1) < 1.0]
    angle = np.linspace(0.0, np.pi, _RINGS + 1)
    line_m = middle_m + radius_m * np.cos(angle)[:, None] * np.array([-1.0, 0.0, 0.0])
    surface_m, triangles = rod(line_m, radius_m * np.sin(angle))
    area_m2 = 4.0 * np.pi * radius_m**2
    return Displacer(middle_m, places_m, area_m2 * radius_m / 3.0, area_m2, surface_m, triangles, radius_m)


def _segment(ends_m: FloatArray, radius_m: float) -> Displacer:
    length_m = float(np.linalg.norm(ends_m[1] - ends_m[0]))
    count = max(int(np.ceil(length_m / _SAMPLE_M)), 1)
    along = (np.arange(count) + 0.5)[:, None] / count
    places_m = ends_m[0] + along * (ends_m[1] - ends_m[0])
    surface_m, triangles = rod(ends_m, np.full(2, radius_m))
    area_m2 = 2.0 * np.pi * radius_m * length_m
    return Displacer(ends_m.mean(axis=0), places_m, 0.5 * area_m2 * radius_m, area_m2, surface_m, triangles)
