"""Camera presets, the same as on the page."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.visualization.picture import PictureLayout

PRESETS = ("scope", "mouth", "side", "top", "ports")
VIEW_ANGLE_DEG = 50.0  # as the page's (`stage.js`), so that both show the same
_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, slots=True)
class Viewpoint:
    """Position and aim of the lens, world frame; `size_m` is the size of the whole duct."""

    position_m: FloatArray
    aim_m: FloatArray
    size_m: float


def place(layout: PictureLayout, preset: str) -> Viewpoint:
    """Return the viewpoint of a preset, in lengths of the duct along it, beside it and up."""
    low, high = layout.rest_m.min(axis=0).astype(float), layout.rest_m.max(axis=0).astype(float)
    s = float(np.linalg.norm(high - low))
    mouth, along = _mouth(layout, high)
    side = np.cross(along, _UP)
    side /= np.linalg.norm(side)
    aim = 0.55 * 0.5 * (low + high) + 0.45 * mouth
    offset = {
        "scope": (0.85, 0.95, 0.95),
        "side": (0.0, 1.75, 0.15),
        "top": (0.02, 0.02, 1.9),
        "ports": (0.9, 4.6, 3.4),
        "mouth": (0.62, 0.12, 0.22),
    }[preset]
    start = mouth if preset == "mouth" else aim
    position = start + s * (offset[0] * along + offset[1] * side + offset[2] * _UP)
    aim = start + (0.8 * s * _UP if preset == "ports" else 0.0)
    return Viewpoint(position, aim, s)


def _mouth(layout: PictureLayout, high: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the middle of the mouth and the direction from the held end to it, along x if they are unnamed."""
    if not (layout.mouth and layout.clamped):
        return high, np.array([1.0, 0.0, 0.0])
    mouth, held = (layout.rest_m[list(nodes)].mean(axis=0, dtype=float) for nodes in (layout.mouth, layout.clamped))
    return mouth, (mouth - held) / np.linalg.norm(mouth - held)
