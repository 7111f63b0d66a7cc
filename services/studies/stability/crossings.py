"""Whether a catheter's centreline crosses a wall, found from positions alone: no collision detection, no memory."""

from __future__ import annotations

from services.mechanics.arrays import FloatArray, IntArray
from services.mechanics.compiled import building_kernel


@building_kernel
def count_crossings(line_m: FloatArray, vertices_m: FloatArray, triangles: IntArray) -> int:
    """Return how many segments of ``line_m`` (n, 3) cross a triangle (m, 3), by Moeller and Trumbore (1997)."""
    count = 0
    for j in range(line_m.shape[0] - 1):
        for t in range(triangles.shape[0]):
            if _crosses(line_m, j, vertices_m, triangles[t]):
                count += 1
                break
    return count


@building_kernel
def _crosses(line: FloatArray, j: int, vertices: FloatArray, triangle: IntArray) -> bool:
    a, b, c = triangle[0], triangle[1], triangle[2]
    for axis in range(3):
        low, high = min(line[j, axis], line[j + 1, axis]), max(line[j, axis], line[j + 1, axis])
        corners = vertices[a, axis], vertices[b, axis], vertices[c, axis]
        if high < min(corners) or low > max(corners):
            return False
    d = (line[j + 1, 0] - line[j, 0], line[j + 1, 1] - line[j, 1], line[j + 1, 2] - line[j, 2])
    e = (vertices[b, 0] - vertices[a, 0], vertices[b, 1] - vertices[a, 1], vertices[b, 2] - vertices[a, 2])
    f = (vertices[c, 0] - vertices[a, 0], vertices[c, 1] - vertices[a, 1], vertices[c, 2] - vertices[a, 2])
    s = (line[j, 0] - vertices[a, 0], line[j, 1] - vertices[a, 1], line[j, 2] - vertices[a, 2])
    p = (d[1] * f[2] - d[2] * f[1], d[2] * f[0] - d[0] * f[2], d[0] * f[1] - d[1] * f[0])
    determinant = e[0] * p[0] + e[1] * p[1] + e[2] * p[2]
    if determinant == 0.0:
        return False
    u = (s[0] * p[0] + s[1] * p[1] + s[2] * p[2]) / determinant
    q = (s[1] * e[2] - s[2] * e[1], s[2] * e[0] - s[0] * e[2], s[0] * e[1] - s[1] * e[0])
    v = (d[0] * q[0] + d[1] * q[1] + d[2] * q[2]) / determinant
    along = (f[0] * q[0] + f[1] * q[1] + f[2] * q[2]) / determinant
    return bool(u >= 0.0 and v >= 0.0 and u + v <= 1.0 and 0.0 <= along <= 1.0)
