"""The duct's wall from its mid-surface: refined, with thickness and a closed rim."""

from __future__ import annotations

import numpy as np

from trocar.services.mechanics.arrays import Float32Array, FloatArray, IntArray
from trocar.services.visualization.normals import vertex_normals

REFINED_UP_TO = 3_000
"""Number of triangles above which a mid-surface needs no refinement."""


def refine(triangles: IntArray, n_points: int) -> tuple[IntArray, IntArray]:
    """Split every triangle in four.

    Returns:
        edges: (m, 2). Ends of the edge on which each new vertex lies; vertex ``n_points + i`` is on edge i.
        fine: (4 t, 3). Triangles, with the orientation of the original ones.
    """
    a, b, c = triangles.T
    pairs = np.sort(np.stack([np.stack([a, b]), np.stack([b, c]), np.stack([c, a])]), axis=1)
    edges, place = np.unique(pairs.transpose(0, 2, 1).reshape(-1, 2), axis=0, return_inverse=True)
    ab, bc, ca = n_points + place.reshape(3, -1)
    fine = np.stack([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]])
    return edges.astype(np.int32), fine.transpose(2, 0, 1).reshape(-1, 3).astype(np.int32)


def boundary(triangles: IntArray) -> IntArray:
    """Return the boundary edges (e, 2), in the direction of their triangle."""
    ends = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]).astype(np.int64)
    base = int(triangles.max()) + 1
    alone = ~np.isin(ends[:, 1] * base + ends[:, 0], ends[:, 0] * base + ends[:, 1])
    return ends[alone].astype(np.int32)


class ThickWall:
    """Outer and inner face and rim of a wall round a mid-surface.

    Args:
        rest_m, triangles: Mid-surface (n, 3) and its triangles (t, 3), counter-clockwise seen from outside.
        thickness_m: Thickness, half on each side.
        fine: Whether each triangle is split in four, on the curved surface through its corners; up to `REFINED_UP_TO`.

    Attributes:
        triangles: (u, 3) int32. Triangles of the drawn surface, whose vertices `update` writes.
        outer: (v, 3) int32. Those of its outer face.
        n_middle, n_points: int. Number of vertices of the outer face, which come first, and of the whole surface.
    """

    def __init__(self, rest_m: Float32Array, triangles: IntArray, thickness_m: float, *, fine: bool) -> None:
        self._coarse = np.ascontiguousarray(triangles, np.int32)
        self._half_m = 0.5 * thickness_m
        self._edges, self._fine = np.zeros((0, 2), np.int32), self._coarse
        if fine and len(self._coarse) <= REFINED_UP_TO:
            self._edges, self._fine = refine(self._coarse, len(rest_m))
        self._rim = boundary(self._fine)
        count = len(rest_m) + len(self._edges)
        self._middle, self._normals = np.zeros((2, count, 3), np.float32)
        self._coarse_normals = np.zeros((len(rest_m), 3), np.float32)
        self.n_middle, self.n_points = count, 2 * count + 4 * len(self._rim)
        self.outer = self._fine
        corner = 2 * count + 4 * np.arange(len(self._rim))[:, None]
        sides = np.concatenate([corner + np.array(three) for three in ((0, 2, 1), (1, 2, 3))])
        self.triangles = np.concatenate([self._fine, self._fine[:, [0, 2, 1]] + count, sides]).astype(np.int32)

    def update(self, points_m: Float32Array, out_m: Float32Array, normals: Float32Array) -> None:
        """Write vertices and their normals (`n_points`, 3) of the wall round `points_m` (n, 3)."""
        self._place_middle(points_m)
        middle, away = self._middle, self._normals
        count, offset_m = len(middle), np.float32(self._half_m) * away
        np.add(middle, offset_m, out=out_m[:count])
        np.subtract(middle, offset_m, out=out_m[count : 2 * count])
        normals[:count] = away
        np.negative(away, out=normals[count : 2 * count])
        self._close_rim(out_m, normals)

    def of_nodes(self, values: FloatArray) -> FloatArray:
        """Interpolate values at the nodes (n,) to the vertices (`n_points`,)."""
        middle = np.concatenate([values, values[self._edges].mean(axis=1)])
        a, b = self._rim.T
        return np.concatenate([middle, middle, middle[np.stack([a, b, a, b], axis=1)].ravel()])

    def _place_middle(self, points_m: Float32Array) -> None:
        """Place new vertices on the cubic of their edge (point-normal triangles, Vlachos 2001)."""
        vertex_normals(points_m, self._coarse, self._coarse_normals)
        count = len(points_m)
        self._middle[:count] = points_m
        a, b = self._edges.T
        start, end, normals = points_m[a], points_m[b], self._coarse_normals
        along = end - start
        rise, fall = (np.sum(along * n, axis=1, keepdims=True) * n for n in (normals[a], normals[b]))
        self._middle[count:] = 0.5 * (start + end) - 0.125 * (rise - fall)
        vertex_normals(self._middle, self._fine, self._normals)

    def _close_rim(self, out_m: Float32Array, normals: Float32Array) -> None:
        count = len(self._middle)
        a, b = self._rim.T
        ends = np.stack([a, b, count + a, count + b], axis=1)
        out_m[2 * count :] = out_m[ends].reshape(-1, 3)
        away = np.cross(self._middle[b] - self._middle[a], self._normals[a])
        away /= np.maximum(np.linalg.norm(away, axis=1, keepdims=True), np.float32(1e-12))
        normals[2 * count :].reshape(-1, 4, 3)[:] = away[:, None]
