"""A ring where a tool would hit the wall along its shaft, which closes as the tool approaches.

It gives a monocular picture some depth. The page draws the same ring (`web/src/view/cue.js`).
"""

from __future__ import annotations

import numpy as np
import pyvista as pv

from trocar.services.mechanics.arrays import Float32Array, FloatArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.vectors import cross, dot, row, subtract
from trocar.services.visualization.picture import ToolShape

REACH_M = 40e-3
"""Largest distance from the tip at which the ring is shown: a hand at 0.1 m/s sees it for 0.4 s before it touches."""
#: Distance that counts as touch, and by which the ring lies above the wall, so that it is not hidden in it.
_TOUCHES_M, _LIFT_M = 0.4e-3, 0.12e-3
_FAR, _NEAR = "#b8fff0", "#ffd479"
_ANGLE_RAD = 2.0 * np.pi * np.arange(28) / 28


def first_met_m(corners_m: Float32Array, origins_m: FloatArray, direction: FloatArray) -> FloatArray:
    """Return the distance along a unit direction from each origin (r, 3) to the first hit triangle (m, 3, 3).

    Both sides of triangles count; the distance is infinite without a hit.
    """
    nearest_m = np.full(len(origins_m), np.inf)
    _meet(corners_m.reshape(-1, 3), np.asarray(origins_m, float), direction, nearest_m)
    return nearest_m


@kernel
def _meet(corners_m: Float32Array, origins_m: FloatArray, direction: FloatArray, nearest_m: FloatArray) -> None:
    """Shorten ``nearest_m`` (r,) by triangles, three corners each (Moeller and Trumbore, J. Graphics Tools 2, 1997)."""
    ahead = (direction[0], direction[1], direction[2])
    for m in range(0, corners_m.shape[0], 3):
        a = row(corners_m, m)
        u, v = subtract(row(corners_m, m + 1), a), subtract(row(corners_m, m + 2), a)
        across = cross(ahead, v)
        size = dot(u, across)
        if size == 0.0:
            continue
        for r in range(origins_m.shape[0]):
            from_a = subtract(row(origins_m, r), a)
            s = dot(from_a, across) / size
            if s < 0.0 or s > 1.0:
                continue
            turned = cross(from_a, u)
            t, far_m = dot(turned, ahead) / size, dot(turned, v) / size
            if t >= 0.0 and s + t <= 1.0 and 0.0 <= far_m < nearest_m[r]:
                nearest_m[r] = far_m


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
        met_m = float(first_met_m(corners_m, pose[None, :3], direction)[0]) if shown else np.inf
        gap_m = max(0.0, met_m - self._tip_m)
        self._actor.visibility = gap_m <= REACH_M
        if gap_m > REACH_M:
            return
        inner_m = 0.9 * self._radius_m + 0.11 * gap_m
        radii_m = np.array([inner_m, inner_m + 0.45e-3 + 0.02 * gap_m])
        back_m = 4.0 * radii_m[1] + 4e-3
        at_m = pose[:3] + met_m * direction
        from_m = at_m - back_m * direction + _circles(direction, radii_m)
        far_m = first_met_m(corners_m, from_m, direction)
        far_m = np.where(np.isfinite(far_m), far_m, back_m) - _LIFT_M
        self._mesh.points = (from_m + far_m[:, None] * direction).astype(np.float32)
        self._actor.prop.color = _NEAR if gap_m < _TOUCHES_M else _FAR
        self._actor.prop.opacity = 0.35 + 0.6 * (1.0 - gap_m / REACH_M) ** 2


def _circles(normal: FloatArray, radii_m: FloatArray) -> FloatArray:
    """Return points (2 k, 3) of two circles about the origin across a unit vector, taken in turns."""
    across = np.cross(normal, (0.0, 0.0, 1.0) if abs(normal[2]) < 0.9 else (1.0, 0.0, 0.0))
    across /= np.linalg.norm(across)
    way = np.cos(_ANGLE_RAD)[:, None] * across + np.sin(_ANGLE_RAD)[:, None] * np.cross(normal, across)
    points: FloatArray = (radii_m[None, :, None] * way[:, None]).reshape(-1, 3)
    return points
