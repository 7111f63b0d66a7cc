"""Caps over the open rims of a surface: triangles that close it."""

from __future__ import annotations

import numpy as np

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.compiled import building_kernel


def fill_rim(vertices_m: FloatArray, rim: IntArray) -> IntArray:
    """Return (k - 2, 3) triangles of least total area over a rim of k vertices, wound to close the surface.

    Dynamic programming over all triangulations of the polygon, O(k^3) (Barequet and Sharir, "Filling gaps in
    the boundary of a polyhedron", 1995). Unlike a fan it bridges the lips of an incision directly.
    """
    split = _least_area_splits(np.ascontiguousarray(vertices_m[rim]))
    triangles, open_spans = [], [(0, len(rim) - 1)]
    while open_spans:
        low, high = open_spans.pop()
        if high - low < 2:
            continue
        middle = int(split[low, high])
        # The rim runs along its wall triangles; the cap runs against it.
        triangles.append((rim[high], rim[middle], rim[low]))
        open_spans += [(low, middle), (middle, high)]
    return np.array(triangles, np.int32).reshape(-1, 3)


@building_kernel
def _least_area_splits(points: FloatArray) -> IntArray:
    n = points.shape[0]
    cost = np.zeros((n, n))
    split = np.zeros((n, n), np.int32)
    for span in range(2, n):
        for low in range(n - span):
            high = low + span
            cost[low, high] = np.inf
            for middle in range(low + 1, high):
                u, v = points[middle] - points[low], points[high] - points[low]
                x = u[1] * v[2] - u[2] * v[1]
                y = u[2] * v[0] - u[0] * v[2]
                z = u[0] * v[1] - u[1] * v[0]
                area = np.sqrt(x * x + y * y + z * z) + cost[low, middle] + cost[middle, high]
                if area < cost[low, high]:
                    cost[low, high], split[low, high] = area, middle
    return split
