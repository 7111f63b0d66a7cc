"""A place of a duct behind its mouth: the middle of the section there, its axis, and where a line across meets it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.surface.centreline import surface_tree
from trocar.services.mechanics.surface.mesh import TriangleMesh, unique_edges, vertex_areas_m2

_BAND_EDGES = 1.0
"""Half the width, in mean edges, of the bands of the surface whose middles are taken."""
_ALONG = 0.9
"""Cosine to the duct's axis beyond which a direction says nothing of what is across the duct."""
_REACH_RADII = 2.0
"""From a section's middle: as all around it is one radius away, so far needs another part of the duct."""


@dataclass(frozen=True, slots=True)
class CrossSection:
    """A section of a duct.

    Attributes:
        middle_m: (3,) float64.
        inward: (3,) float64. Unit vector along the duct, away from the mouth.
        radius_m: float. Mean distance of the surface from the axis.
    """

    middle_m: FloatArray
    inward: FloatArray
    radius_m: float

    @property
    def reach_m(self) -> float:
        """Distance from the middle within which the wall is of this part of the duct."""
        return _REACH_RADII * self.radius_m

    def across(self, direction: tuple[float, float, float]) -> FloatArray:
        """Return the unit vector (3,) across the duct that is nearest to a direction, which must not be zero.

        Raises ValueError if the direction is nearly along the duct.
        """
        wanted = np.array(direction) / np.linalg.norm(direction)
        along = wanted @ self.inward
        if abs(along) > _ALONG:
            raise ValueError(f"{list(direction)} is along the duct there, not across")
        rest = wanted - along * self.inward
        across: FloatArray = rest / np.linalg.norm(rest)
        return across


@dataclass(frozen=True, slots=True)
class SurfacePoint:
    """A point of a surface: its triangle, its barycentric weights (3,), and where it is (3,) in m."""

    triangle: int
    weights: FloatArray
    place_m: FloatArray


def section_behind_mouth(mesh: TriangleMesh, at_m: float) -> CrossSection:
    """Return the section whose surface lies ``at_m`` from the mouth, along the surface.

    Raises ValueError: the duct ends before.
    """
    edges, _ = unique_edges(mesh)
    edge_m = float(np.linalg.norm(np.diff(mesh.vertices_m[edges], axis=1), axis=2).mean())
    distance_m = surface_tree(mesh, mesh.vertex_sets["mouth"]).distance_m
    half_m, areas_m2 = _BAND_EDGES * edge_m, vertex_areas_m2(mesh)
    bands = [np.abs(distance_m - at) <= half_m for at in (max(at_m - 2.0 * half_m, half_m), at_m, at_m + 2.0 * half_m)]
    if not (bands[1].any() and bands[2].any()):
        raise ValueError(f"the duct has no wall {1e3 * at_m:g} mm behind its mouth, it ends before")
    before_m, middle_m, beyond_m = (np.average(mesh.vertices_m[own], axis=0, weights=areas_m2[own]) for own in bands)
    inward = (beyond_m - before_m) / np.linalg.norm(beyond_m - before_m)
    here = bands[1]
    middle_m += (at_m - np.average(distance_m[here], weights=areas_m2[here])) * inward
    away = mesh.vertices_m[here] - middle_m
    radii_m = np.linalg.norm(away - np.outer(away @ inward, inward), axis=1)
    return CrossSection(middle_m, inward, float(radii_m.mean()))


def pierced_m(mesh: TriangleMesh, start_m: FloatArray, direction: FloatArray) -> SurfacePoint | None:
    """Return the first point in which a ray meets the surface (Möller and Trumbore, 1997), None if it does not."""
    a, b, c = (mesh.vertices_m[mesh.triangles[:, corner]] for corner in range(3))
    first, second, away = b - a, c - a, start_m - a
    normal = np.cross(direction, second)
    volume = np.einsum("ij,ij->i", first, normal)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = np.einsum("ij,ij->i", away, normal) / volume
        turned = np.cross(away, first)
        v = turned @ direction / volume
        at = np.einsum("ij,ij->i", second, turned) / volume
        met = (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1.0 + 1e-9) & (at > 0.0)
    if not met.any():
        return None
    triangle = int(np.flatnonzero(met)[np.argmin(at[met])])
    weights = np.array([1.0 - u[triangle] - v[triangle], u[triangle], v[triangle]])
    return SurfacePoint(triangle, weights, start_m + at[triangle] * direction)
