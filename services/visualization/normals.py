"""Vertex normals, as VTK silently keeps old ones of a mesh that already has some."""

from __future__ import annotations

from trocar.services.mechanics.arrays import Float32Array, IntArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.vectors import cross, row, subtract, unit


@kernel
def vertex_normals(points: Float32Array, triangles: IntArray, out: Float32Array) -> None:
    """Write into ``out`` (n, 3) the unit normals of ``points``, the area-weighted mean of the triangles round each.

    A vertex of no triangle, or of triangles without area, gets zero.
    """
    out[:] = 0.0
    for t in range(triangles.shape[0]):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        start = row(points, a)
        area = cross(subtract(row(points, b), start), subtract(row(points, c), start))
        for corner in (a, b, c):
            for k in range(3):
                out[corner, k] += area[k]
    for i in range(out.shape[0]):
        normal = unit(row(out, i))
        for k in range(3):
            out[i, k] = normal[k]
