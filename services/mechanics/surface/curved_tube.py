"""A tube along any curve, with a width that varies along it and, on demand, folds that wind round its lumen."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.surface.branched_tubes import Tube

_DETAIL_OF_WIDTH = 1.1
"""A fold is meshed as a tube of that radius is: before it is thrown, two to three edges have its width."""
_GRADING = 0.5
"""By which the detail grows with the distance from the folds."""
_NEAREST = 4
"""Stations of the axis whose balls are asked for the distance of a point: the radius varies slowly along it."""


@dataclass(frozen=True)
class Folds:
    """Crescents of a lumen, each oblique, one behind the other along a line that winds round as a screw thread does.

    Attributes:
        from_m, to_m: Where on the axis the first begins and the last ends.
        pitch_m: Distance of one from the next along the axis.
        height_m, end_height_m: By how much they narrow the radius at most, where the first begins and the last ends.
        width_m: Along the axis, where they have half their height.
        arc_rad: How far each reaches round the axis; its height rises from 0 and falls to 0 over it.
        begin_rad: Where round the axis the first begins.
        is_left: They wind the other way.
    """

    from_m: float
    to_m: float
    pitch_m: float
    height_m: float
    end_height_m: float
    width_m: float
    arc_rad: float
    begin_rad: float = 0.0
    is_left: bool = False

    def inward_m(self, at_m: FloatArray, around_rad: FloatArray) -> FloatArray:
        """Return how far the folds reach into the lumen (n,) at places along and angles round the axis."""
        lead_m = self.pitch_m * 2.0 * np.pi / self.arc_rad
        turned = (-1.0 if self.is_left else 1.0) * (around_rad - self.begin_rad) / (2.0 * np.pi)
        turns = turned + np.round((at_m - self.from_m) / lead_m - turned)  # of the line, where it is nearest
        off_m = at_m - self.from_m - lead_m * turns
        ridge = np.exp(-math.log(2.0) * (2.0 * off_m / self.width_m) ** 2)
        along = lead_m * turns / self.pitch_m  # in crescents
        is_there = (along > 0.0) & (along < (self.to_m - self.from_m) / self.pitch_m)
        crescent = np.where(is_there, np.sin(np.pi * along) ** 2, 0.0)
        height_m = np.interp(at_m, (self.from_m, self.to_m), (self.height_m, self.end_height_m))
        inward: FloatArray = height_m * ridge * crescent
        return inward


@dataclass(frozen=True)
class CurvedTube(Tube):
    """A tube along a polyline.

    Attributes:
        points_m: (k, 3) float64. Axis, at equal distances.
        radii_m: (k,) float64.
        sides: (k, 3) float64. Unit vectors across the axis that do not turn about it.
        folds: Folds, optional.
        opening: Name of the opening at its near end; empty where that lies in another tube, or is the mouth.
    """

    points_m: FloatArray
    radii_m: FloatArray
    sides: FloatArray
    folds: Folds | None = None
    opening: str = ""

    def detail_m(self) -> float:
        """Return the smallest radius of its surface; folds are a detail of it."""
        return float(self.radii_m.min())

    @property
    def has_details(self) -> bool:
        """Whether it has folds."""
        return self.folds is not None

    def details_m(self, points_m: FloatArray) -> FloatArray:
        """Return the detail (n,) by which it is meshed near points (n, 3): of its folds, growing away from them."""
        if self.folds is None:
            return super().details_m(points_m)
        nearest = np.asarray(scipy.spatial.KDTree(self.points_m).query(points_m)[1])
        at_m = nearest * self.length_m / (len(self.points_m) - 1)
        away_m = np.maximum(np.maximum(self.folds.from_m - at_m, at_m - self.folds.to_m), 0.0)
        detail_m: FloatArray = _DETAIL_OF_WIDTH * self.folds.width_m + _GRADING * away_m
        return detail_m

    def near_opening(self) -> str:
        """Return the name of the opening at its near end."""
        return self.opening

    def place(self, at_m: float) -> tuple[FloatArray, FloatArray]:
        """Return the point of the axis at arc length ``at_m``, and the tube's axes there."""
        stations = np.linspace(0.0, self.length_m, len(self.points_m))
        point = np.array([np.interp(at_m, stations, axis) for axis in self.points_m.T])
        k = int(np.clip(np.searchsorted(stations, at_m), 1, len(stations) - 1))
        tangent = self.points_m[k] - self.points_m[k - 1]
        tangent /= np.linalg.norm(tangent)
        side = self.sides[k] - (self.sides[k] @ tangent) * tangent
        side /= np.linalg.norm(side)
        return point, np.stack([tangent, side, np.cross(tangent, side)])

    def radius_at(self, at_m: float) -> float:
        """Return the radius at arc length ``at_m``, without folds."""
        return float(np.interp(at_m, np.linspace(0.0, self.length_m, len(self.radii_m)), self.radii_m))

    def distance_m(self, points_m: FloatArray) -> FloatArray:
        """Return signed distances (n,) of points (n, 3) from its surface, negative inside; its ends are rounded.

        It is the surface without folds: into those what has been meshed is thrown, see `folded_m`.
        """
        away, nearest = map(np.asarray, scipy.spatial.KDTree(self.points_m).query(points_m, k=_NEAREST))
        distance: FloatArray = (away - self.radii_m[nearest]).min(axis=1)
        return distance

    def folded_m(self, points_m: FloatArray) -> FloatArray:
        """Return points (n, 3) of its smooth surface where its folds take them, straight towards its axis."""
        if self.folds is None:
            return points_m
        at_m, around, radial = self._places(points_m)
        inward_m = self.folds.inward_m(at_m, around)
        folded: FloatArray = points_m - (inward_m / np.linalg.norm(radial, axis=1))[:, None] * radial
        return folded

    def inward_m(self, points_m: FloatArray) -> FloatArray:
        """Return how far its folds reach into the lumen (n,) at points (n, 3) of its surface, folded or smooth."""
        if self.folds is None:
            return super().inward_m(points_m)
        at_m, around, _ = self._places(points_m)
        return self.folds.inward_m(at_m, around)

    def _places(self, points_m: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return where on its axis points (n, 3) lie, in m, at which angle round it, and their offsets across it."""
        tangents = np.gradient(self.points_m, axis=0)
        tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
        k = np.asarray(scipy.spatial.KDTree(self.points_m).query(points_m)[1])
        out, tangent, side = points_m - self.points_m[k], tangents[k], self.sides[k]
        along = np.einsum("ij,ij->i", out, tangent)
        radial = out - along[:, None] * tangent
        around = np.arctan2(np.einsum("ij,ij->i", radial, np.cross(tangent, side)), np.einsum("ij,ij->i", radial, side))
        return k * self.length_m / (len(self.points_m) - 1) + along, around, radial


def curved_tube(
    name: str,
    points_m: FloatArray,
    radii_m: FloatArray,
    far_end: str,
    folds: Folds | None = None,
    opening: str = "",
) -> CurvedTube:
    """Return a tube along points (k, 3) at equal distances with radii (k,)."""
    tangents = np.gradient(points_m, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    sides = _parallel_sides(tangents)
    length_m = float(np.linalg.norm(np.diff(points_m, axis=0), axis=1).sum())
    axes = np.stack([tangents[0], sides[0], np.cross(tangents[0], sides[0])])
    ends = float(radii_m[0]), float(radii_m[-1])
    return CurvedTube(name, points_m[0], axes, length_m, *ends, 0.0, far_end, points_m, radii_m, sides, folds, opening)


def _parallel_sides(tangents: FloatArray) -> FloatArray:
    """Return unit vectors across tangents (k, 3) that are carried along without turning about them."""
    side = np.cross(tangents[0], np.eye(3)[np.argmin(np.abs(tangents[0]))])
    sides = np.empty_like(tangents)
    for k, tangent in enumerate(tangents):
        side = side - (side @ tangent) * tangent
        side /= np.linalg.norm(side)
        sides[k] = side
    return sides
