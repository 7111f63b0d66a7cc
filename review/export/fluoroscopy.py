"""The view as by X-rays: what wall and instruments leave of each ray, by Beer and Lambert. No display and no VTK.

A ray's way through a closed surface is the sum of the places where it leaves it less those where it enters. That sum is
taken triangle by triangle in double precision; VTK's framebuffers hold 8 bits, in which adding up saturates.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from trocar.services.mechanics.arrays import Float32Array, FloatArray, IntArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.vectors import Vector, cross, dot, row, subtract
from trocar.services.visualization.picture import Picture, PictureLayout
from trocar.services.visualization.thick_wall import ThickWall
from trocar.services.visualization.tube import sweep_tube, tube_triangles

WALL_1_M, CATHETER_1_M, STEEL_1_M = 60.0, 900.0, 950.0
"""Attenuation at some 60 keV: of the wall three times soft tissue's, or it would not be seen; of a catheter as of
plastic with barium, an assumption; of steel, as of a guide wire."""
SOURCE_M = 0.7
"""From the tube of the X-rays to the duct's middle: an assumption."""
_FILLS = 0.9  # of the picture, so that the duct does not touch its edge
_SIDES = 32  # so that a catheter differs from a circle by 0.5 %, less than a pixel, as 1 - cos(pi / 32)
_CAP_M = 1e-6  # radius of a closed end: nothing in the picture, and not zero, as normals need a direction
_GRID = 256
"""Parts of a pixel on which corners lie: whole numbers, so that what two triangles share belongs to one of them."""


@dataclass(frozen=True, slots=True)
class Lens:
    """Where the source is, rows right, down and ahead, and the distance of the detector in its own pixels."""

    eye_m: FloatArray
    axes: FloatArray
    focal: float

    def seen_m(self, points_m: FloatArray | Float32Array) -> FloatArray:
        """Return points (n, 3) by right, down and ahead."""
        seen: FloatArray = (points_m - self.eye_m) @ self.axes.T
        return seen


def lens_on(points_m: FloatArray | Float32Array, size: tuple[int, int]) -> Lens:
    """Return the lens that sees points (n, 3) spread out most, the longer way across; it is turned as a C-arm is.

    What is up in the scene, +z, is up in the picture, too, unless one looks from above.
    """
    middle = 0.5 * (points_m.min(axis=0) + points_m.max(axis=0)).astype(float)
    _, axes = np.linalg.eigh(np.cov(points_m.T.astype(float)))
    right, back = (axis * np.sign(axis[np.abs(axis).argmax()]) for axis in (axes[:, 2], axes[:, 0]))
    ahead = back if np.cross(right, back)[2] > 0.5 else -back
    lens = Lens(middle - SOURCE_M * ahead, np.stack([right, np.cross(ahead, right), ahead]), 1.0)
    seen = lens.seen_m(points_m)
    across = np.abs(seen[:, :2] / seen[:, 2:]).max(axis=0)
    return Lens(lens.eye_m, lens.axes, _FILLS * 0.5 * float(min(np.array(size) / across)))


class Fluoroscope:
    """Draws layouts and pictures as `render.Renderer` does, off the screen.

    Args:
        size: Width and height in pixels.
    """

    def __init__(self, size: tuple[int, int] = (800, 600)) -> None:
        self._size = size
        self._layout: PictureLayout | None = None
        self._weakened = np.zeros(size[::-1])

    def update(self, layout: PictureLayout, picture: Picture) -> None:
        """Add up what weakens each ray; the lens stays where it is for as long as there is the same duct."""
        if self._layout is None or layout.rest_m is not self._layout.rest_m:
            self._lens = lens_on(layout.rest_m, self._size)
            self._wall = ThickWall(layout.rest_m, layout.triangles, layout.thickness_m, fine=True)
            self._wall_m, self._normals = np.zeros((2, self._wall.n_points, 3), np.float32)
        self._layout = layout
        self._wall.update(picture.points_m, self._wall_m, self._normals)
        self._weakened[:] = 0.0
        self._add(WALL_1_M, self._wall_m, self._wall.triangles)
        for (part, radius_m), factor_1_m in zip(layout.rods(), (CATHETER_1_M, STEEL_1_M), strict=False):
            if len(line_m := picture.centreline_m[part]) > 1:
                self._add(factor_1_m, *rod(line_m, np.full(len(line_m), radius_m)))
        for shape, pose in zip(layout.tools, picture.poses, strict=True):
            shaft = Rotation.from_quat(pose[3:], scalar_first=True).as_matrix()[:, 0]
            for x_m, radii_m in (np.array(part.profile).T for part in shape.parts):
                self._add(STEEL_1_M, *rod(pose[:3] + x_m[:, None] * shaft, radii_m))

    def image(self) -> npt.NDArray[np.uint8]:
        """Return the picture (height, width, 3): white where nothing weakens a ray."""
        grey = np.round(255.0 * np.exp(-self._weakened)).astype(np.uint8)
        return np.repeat(grey[:, :, None], 3, axis=2)

    def close(self) -> None:
        """Give up nothing: nothing is held."""

    def _add(self, attenuation_1_m: float, points_m: FloatArray | Float32Array, triangles: IntArray) -> None:
        add_way(self._lens.seen_m(points_m), triangles, self._lens.focal, attenuation_1_m, self._weakened)


def rod(line_m: FloatArray | Float32Array, radii_m: FloatArray) -> tuple[Float32Array, IntArray]:
    """Return points and triangles of the closed surface round a line (n, 3) with a radius (n,) at each point."""
    ends = np.diff(line_m[[0, 1, -2, -1]], axis=0)[[0, 2]]
    ends *= _CAP_M / np.maximum(np.linalg.norm(ends, axis=1, keepdims=True), 1e-12)
    line = np.concatenate([line_m[:1] - ends[:1], line_m, line_m[-1:] + ends[1:]]).astype(np.float32)
    radii = np.concatenate([[0.0], radii_m, [0.0]]).astype(np.float32)
    points, normals = np.zeros((2, len(line) * _SIDES, 3), np.float32)
    sweep_tube(line, radii, points, normals)
    return points, tube_triangles(len(line), _SIDES)


@kernel
def add_way(points: FloatArray, triangles: IntArray, focal: float, factor: float, out: FloatArray) -> None:
    """Add to ``out`` (h, w) ``factor`` times each ray's way through a closed surface, whose normals lead out.

    ``points`` (n, 3) are by right, down and ahead of the source, all of them ahead of it.
    """
    for t in range(triangles.shape[0]):
        a, b, c = row(points, triangles[t, 0]), row(points, triangles[t, 1]), row(points, triangles[t, 2])
        if min(a[2], b[2], c[2]) > 0.0:
            _add_triangle((a, b, c), focal, factor, out)


@kernel
def _add_triangle(corners: tuple[Vector, Vector, Vector], focal: float, factor: float, out: FloatArray) -> None:
    h, w = out.shape
    a, b, c = corners
    (ax, ay), (bx, by), (cx, cy) = _pixel(a, focal, w, h), _pixel(b, focal, w, h), _pixel(c, focal, w, h)
    twice = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    if twice == 0:
        return
    normal = cross(subtract(b, a), subtract(c, a))
    level, low, high = dot(normal, a), min(a[2], b[2], c[2]), max(a[2], b[2], c[2])
    leaves = factor if twice > 0 else -factor
    if twice < 0:
        bx, by, cx, cy = cx, cy, bx, by
    (left, right), (top, bottom) = _span((ax, bx, cx), w), _span((ay, by, cy), h)
    for j in range(top, bottom):
        for i in range(left, right):
            at = (_GRID * i + _GRID // 2, _GRID * j + _GRID // 2)
            inside = _is_left((ax, ay), (bx, by), at) and _is_left((bx, by), (cx, cy), at)
            if inside and _is_left((cx, cy), (ax, ay), at):
                x, y = (i + 0.5 - 0.5 * w) / focal, (j + 0.5 - 0.5 * h) / focal
                facing = normal[0] * x + normal[1] * y + normal[2]
                ahead = min(max(level / facing if facing != 0.0 else low, low), high)
                out[j, i] += leaves * ahead * math.sqrt(1.0 + x * x + y * y)


@kernel
def _span(places: tuple[int, int, int], size: int) -> tuple[int, int]:
    """From which pixel of a line of the picture to before which one corners at these places reach."""
    return max(min(places) // _GRID, 0), min(max(places) // _GRID + 1, size)


@kernel
def _pixel(point: Vector, focal: float, w: int, h: int) -> tuple[int, int]:
    """Return where a point is in the picture, in parts of a pixel; far beside it no farther than whole numbers bear."""
    x, y = 0.5 * w + focal * point[0] / point[2], 0.5 * h + focal * point[1] / point[2]
    return round(_GRID * min(max(x, -1e5), 1e5)), round(_GRID * min(max(y, -1e5), 1e5))


@kernel
def _is_left(start: tuple[int, int], end: tuple[int, int], point: tuple[int, int]) -> bool:
    """Return whether a point is inside of an edge; on it, for one of the edge's two directions."""
    dx, dy = end[0] - start[0], end[1] - start[1]
    side = dx * (point[1] - start[1]) - dy * (point[0] - start[0])
    return side > 0 or (side == 0 and (dy > 0 or (dy == 0 and dx < 0)))
