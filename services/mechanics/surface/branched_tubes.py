"""Branching tubes as a solid: their axes, and the signed distance from their smooth union."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from trocar.services.mechanics.arrays import FloatArray

BLEND = 0.6
"""Width, in radii of a branch, of its smooth transition into the parent."""
_SAMPLES_PER_RADIUS = 8.0
_STRAIGHT_1_M = 1e-9


@dataclass(frozen=True)
class Tube:
    """A round tube with taper along an arc, from its near end on.

    Attributes:
        name
        origin_m, axes: (3,), (3, 3) float64. Its near end, and as rows the axes there: the tangent, the side to which
            it bends, and across both.
        length_m, radius_m, end_radius_m, curvature_1_m
        far_end: "held" or "free" for an opening, "blind", or "on" where a branch continues.
    """

    name: str
    origin_m: FloatArray
    axes: FloatArray
    length_m: float
    radius_m: float
    end_radius_m: float
    curvature_1_m: float
    far_end: str

    def place(self, at_m: float) -> tuple[FloatArray, FloatArray]:
        """Return the point of the axis at arc length ``at_m``, and the tube's axes there."""
        angle, (on, aside, across) = self.curvature_1_m * at_m, self.axes
        if abs(self.curvature_1_m) < _STRAIGHT_1_M:
            return self.origin_m + at_m * on, self.axes
        way = math.sin(angle) * on + (1.0 - math.cos(angle)) * aside
        turned_on = math.cos(angle) * on + math.sin(angle) * aside
        turned_aside = math.cos(angle) * aside - math.sin(angle) * on
        return self.origin_m + way / self.curvature_1_m, np.stack([turned_on, turned_aside, across])

    def radius_at(self, at_m: float) -> float:
        """Return the radius at arc length ``at_m``."""
        return self.radius_m + (self.end_radius_m - self.radius_m) * at_m / self.length_m

    def detail_m(self) -> float:
        """Return the smallest radius of its surface, by which it is meshed."""
        return min(self.radius_m, self.end_radius_m)

    def details_m(self, points_m: FloatArray) -> FloatArray:
        """Return the detail (n,) by which it is meshed near points (n, 3), infinite where it has none of its own."""
        return np.full(len(points_m), np.inf)

    @property
    def has_details(self) -> bool:
        """Whether it has details finer than its radius."""
        return False

    def folded_m(self, points_m: FloatArray) -> FloatArray:
        """Return points (n, 3) of its smooth surface where its folds take them, if it has any."""
        return points_m

    def inward_m(self, points_m: FloatArray) -> FloatArray:
        """Return how far its folds reach into the lumen (n,) at points (n, 3) of its surface."""
        return np.zeros(len(points_m))

    def near_opening(self) -> str:
        """Return the name of the opening at its near end; empty where that lies in another tube."""
        return ""

    def distance_m(self, points_m: FloatArray) -> FloatArray:
        """Return signed distances (n,) of points (n, 3) from its surface, negative inside; its ends are rounded."""
        smallest_m = min(self.radius_m, self.end_radius_m)
        stations = np.linspace(0.0, self.length_m, 2 + int(_SAMPLES_PER_RADIUS * self.length_m / smallest_m))
        distance = np.full(len(points_m), np.inf)
        for at_m in stations:
            away = points_m - self.place(at_m)[0]
            np.minimum(distance, np.sqrt(np.einsum("ij,ij->i", away, away)) - self.radius_at(at_m), out=distance)
        return distance


def branch_of(parent: Tube, at_m: float, angle_rad: float, azimuth_rad: float) -> tuple[FloatArray, FloatArray]:
    """Return near end and axes of a branch that leaves a tube at ``at_m``."""
    origin_m, (on, aside, across) = parent.place(at_m)
    side = math.cos(azimuth_rad) * aside + math.sin(azimuth_rad) * across
    direction = math.cos(angle_rad) * on + math.sin(angle_rad) * side
    normal = math.cos(angle_rad) * side - math.sin(angle_rad) * on
    return origin_m, np.stack([direction, normal, np.cross(direction, normal)])


def union_distance_m(tubes: list[Tube], points_m: FloatArray) -> FloatArray:
    """Return signed distances (n,) of points (n, 3) from the smooth union of tubes (Quilez's polynomial)."""
    union = tubes[0].distance_m(points_m)
    for tube in tubes[1:]:
        other, blend_m = tube.distance_m(points_m), BLEND * tube.radius_m
        overlap = np.maximum(blend_m - np.abs(union - other), 0.0)
        union = np.minimum(union, other) - 0.25 * overlap**2 / blend_m
    return union
