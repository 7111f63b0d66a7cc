"""Whether a catheter's centreline crosses a wall, found from positions alone: no collision detection, no memory."""

from __future__ import annotations

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.compiled import building_kernel
from trocar.services.mechanics.compiled.vectors import row
from trocar.studies.judge.closest import where_through


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
    u, v, w = row(vertices, a), row(vertices, b), row(vertices, c)
    return bool(where_through(row(line, j), row(line, j + 1), u, v, w) >= 0.0)
