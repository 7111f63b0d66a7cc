"""Vertex normals, computed here: VTK keeps the old ones of a mesh that already has some, without a word."""

from __future__ import annotations

from math import sqrt

import numpy as np
from numba import njit

from services.visualization.picture import Float32Array, IndexArray


@njit(cache=True, nogil=True, fastmath=False)  # type: ignore[untyped-decorator]  # numba has no types
def vertex_normals(points: Float32Array, triangles: IndexArray, out: Float32Array) -> None:
    """Write into ``out`` (n, 3) the unit normals of ``points``: mean of the triangles round each, weighted by area.

    A vertex of no triangle, or of triangles without area, gets zero.
    """
    out[:] = 0.0
    for t in range(triangles.shape[0]):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        ux, uy, uz = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], points[b, 2] - points[a, 2]
        vx, vy, vz = points[c, 0] - points[a, 0], points[c, 1] - points[a, 1], points[c, 2] - points[a, 2]
        x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        for corner in (a, b, c):
            out[corner, 0] += x
            out[corner, 1] += y
            out[corner, 2] += z
    for i in range(out.shape[0]):
        length = sqrt(float(out[i, 0]) ** 2 + float(out[i, 1]) ** 2 + float(out[i, 2]) ** 2)
        if length > 0.0:
            for k in range(3):
                out[i, k] = np.float32(out[i, k] / length)
