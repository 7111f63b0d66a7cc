"""What collision detection reads off a mesh once: neighbours, rings of triangles, caps over the open rims."""

from __future__ import annotations

import numpy as np

from services.mechanics.arrays import FloatArray, IntArray
from services.mechanics.compiled import building_kernel

NO_NEIGHBOUR = -1


def triangle_neighbours(triangles: IntArray) -> IntArray:
    """Return (m, 3) the triangle across edge k -> k + 1 of each triangle, `NO_NEIGHBOUR` at a rim."""
    directed = triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    _, edge = np.unique(np.sort(directed, axis=1), axis=0, return_inverse=True)
    edge = edge.ravel()
    order = np.argsort(edge, kind="stable")
    paired = np.flatnonzero(edge[order[1:]] == edge[order[:-1]])
    neighbour = np.full(len(directed), NO_NEIGHBOUR, np.int32)
    first, second = order[paired], order[paired + 1]
    neighbour[first], neighbour[second] = second // 3, first // 3
    return np.ascontiguousarray(neighbour.reshape(-1, 3))


def triangles_round_vertices(triangles: IntArray, n_vertices: int) -> tuple[IntArray, IntArray]:
    """Return (n + 1,) starts and (3 m,) triangles: those round vertex i are ``ring[start[i]:start[i + 1]]``."""
    corners = triangles.ravel()
    ring = (np.argsort(corners, kind="stable") // 3).astype(np.int32)
    start = np.concatenate([[0], np.cumsum(np.bincount(corners, minlength=n_vertices))])
    return start.astype(np.int32), ring


def rim_vertices(triangles: IntArray, neighbour: IntArray, n_vertices: int) -> np.ndarray:
    """Return (n,) int8, one where a vertex lies on an open rim."""
    on_rim = np.zeros(n_vertices, np.int8)
    triangle, edge = np.nonzero(neighbour == NO_NEIGHBOUR)
    on_rim[triangles[triangle, edge]] = 1
    on_rim[triangles[triangle, (edge + 1) % 3]] = 1
    return on_rim


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
