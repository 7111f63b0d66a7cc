"""A parametric duct: a tube with taper, curved axis, and a mouth that is cut obliquely or slit open."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.surface.mesh import TriangleMesh

MOST_TRIANGLES = 2_000_000
"""Limit of a mesh's size; memory is checked separately when it is solved."""


@dataclass(frozen=True)
class DuctGeometry:
    """Size and shape of a duct's mid-surface; clamped at the axis's start, open at its end (the mouth).

    Attributes:
        radius_m: Radius of the mid-surface at the clamped end.
        length_m: Length of the axis.
        n_around: Triangle edges round a ring.
        n_along: Rows of cells (two triangles each) along the axis.
        wall_thickness_m: Thickness of the wall, half of it on each side of the mid-surface.
        taper: Fraction by which the radius falls towards the mouth: mouth radius = radius_m * (1 - taper).
        curvature_1_m: Curvature of the axis, which leaves the clamped end along +x and bends towards +y.
        cut_angle_rad: Angle between the mouth's plane and the axis's cross-section; the +y side is the longer one.
        slit_length_m: Length of an incision along the wall, from the mouth inwards, on the +y side.
        slit_width_m: Opening of the incision at the mouth; it closes linearly to its inner end.
    """

    radius_m: float
    length_m: float
    n_around: int
    n_along: int
    wall_thickness_m: float = 0.5e-3
    taper: float = 0.0
    curvature_1_m: float = 0.0
    cut_angle_rad: float = 0.0
    slit_length_m: float = 0.0
    slit_width_m: float = 0.0

    def __post_init__(self) -> None:
        for name in ("radius_m", "length_m", "wall_thickness_m"):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) > 0.0):
                raise ValueError(f"duct: {name} must be positive, is {getattr(self, name)}")
        if self.n_around < 3 or self.n_along < 1:
            raise ValueError("duct: n_around must be at least 3 and n_along at least 1")
        if 2 * self.n_around * self.n_along > MOST_TRIANGLES:
            raise ValueError(
                f"duct: n_around times n_along make {2.0 * self.n_around * self.n_along:.2g} triangles, at most "
                f"{MOST_TRIANGLES:.2g} can be solved"
            )
        if self.wall_thickness_m >= 2.0 * self.mouth_radius_m:
            raise ValueError("duct: wall_thickness_m leaves no lumen at the mouth")
        if abs(self.curvature_1_m) * max(self.radius_m, self.mouth_radius_m) >= 1.0:
            raise ValueError("duct: curvature_1_m folds the wall onto itself, it must be below 1 / radius_m")
        if abs(self.curvature_1_m) * self.length_m >= 2.0 * math.pi:
            raise ValueError("duct: curvature_1_m * length_m exceeds a full turn")
        if not abs(self.cut_angle_rad) < 0.5 * math.pi or self._overhang_m >= self.length_m:
            raise ValueError("duct: cut_angle_rad is so steep that the cut reaches the clamped end")
        half_row_m = 0.5 * self.length_m / self.n_along
        if self.slit_length_m and self.n_along < 2:
            raise ValueError("duct: slit_length_m needs n_along of at least 2")
        if self.slit_length_m and not half_row_m <= self.slit_length_m <= self.length_m - half_row_m:
            raise ValueError("duct: slit_length_m must leave half a row of cells (length / 2 n_along) at both ends")
        if not 0.0 <= self.slit_width_m < math.pi * self.mouth_radius_m:
            raise ValueError("duct: slit_width_m must be below half the mouth's circumference")

    @property
    def mouth_radius_m(self) -> float:
        """Radius of the mid-surface at the mouth."""
        return self.radius_m * (1.0 - self.taper)

    @property
    def _overhang_m(self) -> float:
        return abs(math.tan(self.cut_angle_rad)) * self.mouth_radius_m


def parametric_duct(geometry: DuctGeometry) -> TriangleMesh:
    """Mesh the duct with cells whose diagonals alternate, so that no direction is preferred.

    Vertices are numbered ring by ring from the clamped end. ``vertex_sets``: ``clamped`` is the first ring,
    ``mouth`` the free rim in order, down one lip of the incision and up the other where there is one.
    """
    axial, first_slit_ring = _ring_stations(geometry)
    rings = [_ring(geometry, s, i >= first_slit_ring) for i, s in enumerate(axial)]
    counts = np.array([len(ring) for ring in rings])
    offsets = np.concatenate([[0], np.cumsum(counts)])
    columns = np.arange(geometry.n_around + 1)
    grid = np.stack([start + columns % count for start, count in zip(offsets[:-1], counts, strict=True)])
    mouth = np.arange(offsets[-2], offsets[-1])
    if first_slit_ring <= geometry.n_along:
        down = grid[first_slit_ring:-1, -1][::-1]
        up = grid[first_slit_ring:-1, 0]
        mouth = np.concatenate([mouth, down, [grid[first_slit_ring - 1, 0]], up])
    return TriangleMesh(
        np.concatenate(rings),
        alternating_triangles(grid),
        {"clamped": grid[0, :-1].astype(np.int32), "mouth": mouth.astype(np.int32)},
    )


def alternating_triangles(grid: IntArray) -> IntArray:
    """Return two triangles for each cell of a (rows, columns) array of vertex indices, diagonals in checkerboard."""
    a, b = grid[:-1, :-1], grid[:-1, 1:]
    d, c = grid[1:, :-1], grid[1:, 1:]
    falling = np.add.outer(np.arange(a.shape[0]), np.arange(a.shape[1]))[..., None] % 2 == 0
    first = np.where(falling, np.stack([a, b, c], -1), np.stack([a, b, d], -1))
    second = np.where(falling, np.stack([a, c, d], -1), np.stack([b, c, d], -1))
    return np.stack([first, second], axis=2).reshape(-1, 3).astype(np.int32)


def _ring_stations(geometry: DuctGeometry) -> tuple[FloatArray, int]:
    """Return the axial position of each ring, one of them at the incision's end, and the first open ring."""
    n = geometry.n_along
    if geometry.slit_length_m == 0.0:
        return np.linspace(0.0, geometry.length_m, n + 1), n + 1
    whole_m = geometry.length_m - geometry.slit_length_m
    n_whole = min(max(1, round(n * whole_m / geometry.length_m)), n - 1)
    whole = np.linspace(0.0, whole_m, n_whole + 1)
    slit = np.linspace(whole_m, geometry.length_m, n - n_whole + 1)
    return np.concatenate([whole, slit[1:]]), n_whole + 1


def _ring(geometry: DuctGeometry, s_m: float, is_slit: bool) -> FloatArray:
    """Return positions round the duct at axial position ``s_m``; a slit ring has one vertex more, one per lip."""
    fraction = s_m / geometry.length_m
    radius = geometry.radius_m * (1.0 - geometry.taper * fraction)
    angle = np.linspace(0.0, 2.0 * math.pi, geometry.n_around + 1)
    if is_slit:
        past_end = 1.0 - (geometry.length_m - s_m) / geometry.slit_length_m
        gap = 0.5 * geometry.slit_width_m * past_end / radius
        angle = gap + angle * (1.0 - gap / math.pi)
    else:
        angle = angle[:-1]
    s = s_m + fraction * math.tan(geometry.cut_angle_rad) * geometry.mouth_radius_m * np.cos(angle)
    turn = geometry.curvature_1_m * s
    # sinc form: exact for a straight axis too.
    along = s * np.sinc(turn / math.pi)
    across = 0.5 * s * turn * np.sinc(0.5 * turn / math.pi) ** 2
    outward = radius * np.cos(angle)
    return np.stack([along - outward * np.sin(turn), across + outward * np.cos(turn), radius * np.sin(angle)], axis=1)
