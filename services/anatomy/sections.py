"""Plane sections of a triangle surface: middle, area and outline, without ordering its points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.surface.mesh import TriangleMesh, edge_of_half_edges


@dataclass(frozen=True, slots=True)
class Section:
    """One closed outline in a plane.

    Attributes:
        middle_m: (3,) float64. Centroid of the area inside.
        area_m2: float.
        least_m: float. Distance of the outline's nearest point from the middle.
    """

    middle_m: FloatArray
    area_m2: float
    least_m: float

    @property
    def diameter_m(self) -> float:
        """Diameter of the circle with this area."""
        return 2.0 * float(np.sqrt(self.area_m2 / np.pi))


class Sectioner:
    """Cuts one closed surface, wound outwards, by many planes."""

    def __init__(self, mesh: TriangleMesh) -> None:
        self._mesh = mesh
        _, edge, _ = edge_of_half_edges(mesh)
        self._edges = edge.reshape(-1, 3)  # edge k of a triangle goes from its corner k to the next

    def cut(self, point_m: FloatArray, normal: FloatArray) -> Section | None:
        """Return the outline round a point, else the one that comes nearest to it; None if the plane misses all."""
        starts, ends, edges = self._segments(point_m, normal)
        if not len(starts):
            return None
        number, label = np.unique(edges, return_inverse=True)
        pairs = label.reshape(edges.shape)
        graph = scipy.sparse.coo_array((np.ones(len(pairs)), pairs.T), shape=(len(number),) * 2)
        _, piece = scipy.sparse.csgraph.connected_components(graph, directed=False)
        of = piece[pairs[:, 0]]
        outlines = [_outline(starts[of == k], ends[of == k], normal) for k in range(int(of.max()) + 1)]
        around = [s for k, s in enumerate(outlines) if _is_around(point_m, starts[of == k], ends[of == k], normal)]
        if around:
            return min(around, key=lambda s: s.area_m2)
        return min(outlines, key=lambda s: float(np.linalg.norm(s.middle_m - point_m)))

    def _segments(self, point_m: FloatArray, normal: FloatArray) -> tuple[FloatArray, FloatArray, IntArray]:
        """Return both ends (s, 3) of the cut through each triangle, relative to the point, and their edges (s, 2)."""
        triangles = self._mesh.triangles
        relative = self._mesh.vertices_m - point_m
        height = relative @ normal
        is_above = height >= 0.0
        above = is_above[triangles]
        through = np.flatnonzero(above.any(axis=1) & ~above.all(axis=1))
        above, corner = above[through], triangles[through]
        rows = np.arange(len(through))
        down = np.argmax(above & ~np.roll(above, -1, axis=1), axis=1)  # the edge that goes down through the plane
        up = np.argmax(~above & np.roll(above, -1, axis=1), axis=1)
        ends = []
        for k in (down, up):
            a, b = corner[rows, k], corner[rows, (k + 1) % 3]
            share = (height[a] / (height[a] - height[b]))[:, None]
            ends.append(relative[a] + share * (relative[b] - relative[a]))
        edges = np.stack([self._edges[through][rows, down], self._edges[through][rows, up]], axis=1)
        return ends[0] + point_m, ends[1] + point_m, edges


def _outline(starts: FloatArray, ends: FloatArray, normal: FloatArray) -> Section:
    base = starts.mean(axis=0)
    a, b = starts - base, ends - base
    parts = 0.5 * np.cross(a, b) @ normal
    area = float(parts.sum())
    middle = base + parts @ (a + b) / (3.0 * area) if area else base
    return Section(middle, abs(area), float(np.linalg.norm(starts - middle, axis=1).min()))


def _is_around(point_m: FloatArray, starts: FloatArray, ends: FloatArray, normal: FloatArray) -> bool:
    """Return whether an outline goes round a point: its angles then add up to a whole turn."""
    a, b = starts - point_m, ends - point_m
    turn = np.arctan2(np.cross(a, b) @ normal, np.einsum("ij,ij->i", a, b)).sum()
    return bool(abs(turn) > np.pi)
