"""Where a tool would meet the wall if it went on along its shaft: a ring that closes as the tool comes near.

The picture of one eye has no depth; the ring gives some. The page draws the same one (`web/src/view/cue.js`).
"""

from __future__ import annotations

import numpy as np
import pyvista as pv

from services.mechanics.arrays import Float32Array, FloatArray
from services.visualization.picture import ToolShape

REACH_M = 40e-3
"""Beyond the tip: what is further away is not aimed at."""
_TOUCHES_M, _LIFT_M = 0.4e-3, 0.12e-3
_EDGE_M = 6e-3  # longer than any edge of a wall as it is drawn
_FAR, _NEAR = "#b8fff0", "#ffd479"
_ANGLE_RAD = 2.0 * np.pi * np.arange(28) / 28


def first_met_m(corners_m: Float32Array, origins_m: FloatArray, direction: FloatArray) -> FloatArray:
    """Return how far along a unit direction each origin (r, 3) is from the first of triangles (m, 3, 3) it meets.

    Triangles count from either side; infinite where none is met (Moeller and Trumbore, J. Graphics Tools 2, 1997).
    """
    a = corners_m[:, 0]
    u, v = corners_m[:, 1] - a, corners_m[:, 2] - a
    from_a = origins_m[:, None] - a
    across = np.cross(direction, v)
    turned = np.cross(from_a, u)
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = 1.0 / np.sum(u * across, axis=1)
        s, t = np.sum(from_a * across, axis=2) * scale, turned @ direction * scale
        far = np.sum(turned * v, axis=2) * scale
        meets = (s >= 0.0) & (t >= 0.0) & (s + t <= 1.0) & (far >= 0.0)
    nearest: FloatArray = np.where(meets, far, np.inf).min(axis=1, initial=np.inf)
    return nearest


class MeetingRing:
    """The ring of one tool."""

    def __init__(self, plotter: pv.Plotter, shape: ToolShape) -> None:
        self._tip_m, self._radius_m = shape.jaw_length_m, shape.jaw_radius_m or 1e-3
        inner = 2 * np.arange(len(_ANGLE_RAD))
        after = np.roll(inner, -1)
        faces = np.stack([np.full_like(inner, 4), inner, inner + 1, after + 1, after], axis=1)
        self._mesh = pv.PolyData(np.zeros((2 * len(inner), 3), np.float32), faces.ravel())
        self._actor = plotter.add_mesh(self._mesh, color=_FAR, lighting=False, opacity=0.9, smooth_shading=False)
        self._actor.visibility = False

    def place(self, corners_m: Float32Array, pose: FloatArray, direction: FloatArray, *, shown: bool) -> None:
        """Lay the ring on the wall's outer face, triangles (m, 3, 3), ahead of a tool with this pose (7,)."""
        met_m = _met_m(corners_m, pose[:3], direction) if shown else np.inf
        gap_m = max(0.0, met_m - self._tip_m)
        self._actor.visibility = gap_m <= REACH_M
        if gap_m > REACH_M:
            return
        inner_m = 0.9 * self._radius_m + 0.11 * gap_m
        radii_m = np.array([inner_m, inner_m + 0.45e-3 + 0.02 * gap_m])
        back_m = 4.0 * radii_m[1] + 4e-3
        at_m = pose[:3] + met_m * direction
        near = np.linalg.norm(corners_m[:, 0] - at_m, axis=1) < back_m + 2e-3
        from_m = at_m - back_m * direction + _circles(direction, radii_m)
        far_m = first_met_m(corners_m[near], from_m, direction)
        far_m = np.where(np.isfinite(far_m), far_m, back_m) - _LIFT_M
        self._mesh.points = (from_m + far_m[:, None] * direction).astype(np.float32)
        self._actor.prop.color = _NEAR if gap_m < _TOUCHES_M else _FAR
        self._actor.prop.opacity = 0.35 + 0.6 * (1.0 - gap_m / REACH_M) ** 2


def _met_m(corners_m: Float32Array, origin_m: FloatArray, direction: FloatArray) -> float:
    """Return how far ahead the wall is; only what has a corner near the ray is looked at closely."""
    away_m = corners_m[:, 0] - origin_m
    beside_2 = np.sum(away_m**2, axis=1) - (away_m @ direction) ** 2
    return float(first_met_m(corners_m[beside_2 < _EDGE_M**2], origin_m[None], direction)[0])


def _circles(normal: FloatArray, radii_m: FloatArray) -> FloatArray:
    """Return points (2 k, 3) of two circles about the origin across a unit vector, taken in turns."""
    across = np.cross(normal, (0.0, 0.0, 1.0) if abs(normal[2]) < 0.9 else (1.0, 0.0, 0.0))
    across /= np.linalg.norm(across)
    way = np.cos(_ANGLE_RAD)[:, None] * across + np.sin(_ANGLE_RAD)[:, None] * np.cross(normal, across)
    points: FloatArray = (radii_m[None, :, None] * way[:, None]).reshape(-1, 3)
    return points
