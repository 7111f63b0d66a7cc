"""Distances between capsules and triangles, each against each, with a sphere around a triangle as the only shortcut.

Formulas: Ericson, Real-Time Collision Detection (2005), 5.1.5 (point and triangle) and 5.1.9 (two segments). The
distance of a segment from a triangle is zero where it passes through, else the least of those of its ends from the
triangle and of the segment from the three edges. But for sums and products of vectors nothing is shared with the
collision detection that it judges.
"""

from __future__ import annotations

import math

import numpy as np

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.compiled import building_kernel
from trocar.services.mechanics.compiled.vectors import (
    Vector,
    along,
    cross,
    dot,
    row,
    row_of,
    squared_distance,
    subtract,
)


@building_kernel
def _unit_interval(x: float) -> float:
    return min(max(x, 0.0), 1.0)


@building_kernel
def segment_segment(p: Vector, q: Vector, r: Vector, s: Vector) -> tuple[float, float, float]:
    """Return the squared distance of two segments, and where on each it is least (0 to 1)."""
    d, e, f = subtract(q, p), subtract(s, r), subtract(p, r)
    a, b, c, g, h = dot(d, d), dot(d, e), dot(d, f), dot(e, e), dot(e, f)
    if a <= 0.0 and g <= 0.0:
        return dot(f, f), 0.0, 0.0
    if a <= 0.0:
        on_first, on_second = 0.0, _unit_interval(h / g)
    elif g <= 0.0:
        on_first, on_second = _unit_interval(-c / a), 0.0
    else:
        across = a * g - b * b
        on_first = _unit_interval((b * h - c * g) / across) if across > 1e-14 * a * g else 0.0
        on_second = (b * on_first + h) / g
        if on_second < 0.0:
            on_first, on_second = _unit_interval(-c / a), 0.0
        elif on_second > 1.0:
            on_first, on_second = _unit_interval((b - c) / a), 1.0
    return squared_distance(along(p, d, on_first), along(r, e, on_second)), on_first, on_second


@building_kernel
def point_triangle(p: Vector, a: Vector, b: Vector, c: Vector) -> float:
    """Return the squared distance of a point from a triangle."""
    ab, ac = subtract(b, a), subtract(c, a)
    normal = cross(ab, ac)
    square = dot(normal, normal)
    if square > 0.0:
        from_a = subtract(p, a)
        v = dot(cross(from_a, ac), normal) / square
        w = dot(cross(ab, from_a), normal) / square
        if v >= 0.0 and w >= 0.0 and v + w <= 1.0:
            height = dot(from_a, normal)
            return height * height / square
    least = segment_segment(p, p, a, b)[0]
    least = min(least, segment_segment(p, p, b, c)[0])
    return min(least, segment_segment(p, p, c, a)[0])


@building_kernel
def where_through(p: Vector, q: Vector, a: Vector, b: Vector, c: Vector) -> float:
    """Return where (0 to 1) a segment passes through a triangle, -1 where it does not; Moeller and Trumbore (1997)."""
    way, ab, ac, from_a = subtract(q, p), subtract(b, a), subtract(c, a), subtract(p, a)
    across = cross(way, ac)
    determinant = dot(ab, across)
    if determinant == 0.0:
        return -1.0
    u = dot(from_a, across) / determinant
    turned = cross(from_a, ab)
    v = dot(way, turned) / determinant
    at = dot(ac, turned) / determinant
    return at if u >= 0.0 and v >= 0.0 and u + v <= 1.0 and 0.0 <= at <= 1.0 else -1.0


@building_kernel
def segment_triangle(p: Vector, q: Vector, a: Vector, b: Vector, c: Vector) -> tuple[float, float]:
    """Return the squared distance of a segment from a triangle, and where on the segment it is least."""
    at = where_through(p, q, a, b, c)
    if at >= 0.0:
        return 0.0, at
    least, where = point_triangle(p, a, b, c), 0.0
    other = point_triangle(q, a, b, c)
    if other < least:
        least, where = other, 1.0
    for start, end in ((a, b), (b, c), (c, a)):
        square, on_segment, _ = segment_segment(p, q, start, end)
        if square < least:
            least, where = square, on_segment
    return least, where


@building_kernel
def nearest_triangles(
    ends_m: FloatArray, reach_m: FloatArray, vertices_m: FloatArray, triangles: IntArray, out: FloatArray
) -> None:
    """Find how far segments are from all triangles.

    Args:
        ends_m: (k, 2, 3)
        reach_m: (k,). What is farther away than this is of no interest.
        vertices_m, triangles: (n, 3) and (m, 3)
        out: (k, 3). Written: the least distance in m, or `reach_m`; where on the segment (0 to 1); the triangle, or -1.
    """
    middles, around = _spheres_around(vertices_m, triangles)
    for i in range(ends_m.shape[0]):
        p = row_of(ends_m, i, 0)
        q = row_of(ends_m, i, 1)
        half = 0.5 * math.sqrt(squared_distance(p, q))
        centre = along(p, subtract(q, p), 0.5)
        out[i, 0], out[i, 1], out[i, 2] = reach_m[i], 0.0, -1.0
        for t in range(triangles.shape[0]):
            middle, near = row(middles, t), out[i, 0] + around[t]
            if squared_distance(centre, middle) > (near + half) * (near + half):
                continue
            if segment_segment(p, q, middle, middle)[0] > near * near:
                continue
            u, v, w = triangles[t, 0], triangles[t, 1], triangles[t, 2]
            square, where = segment_triangle(p, q, row(vertices_m, u), row(vertices_m, v), row(vertices_m, w))
            distance = math.sqrt(square)
            if distance < out[i, 0]:
                out[i, 0], out[i, 1], out[i, 2] = distance, where, t


@building_kernel
def _spheres_around(vertices_m: FloatArray, triangles: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return a sphere around every triangle: centres (m, 3) and radii (m,)."""
    middles, around = np.empty((triangles.shape[0], 3)), np.zeros(triangles.shape[0])
    for t in range(triangles.shape[0]):
        for axis in range(3):
            middles[t, axis] = 0.0
            for corner in range(3):
                middles[t, axis] += vertices_m[triangles[t, corner], axis] / 3.0
        for corner in range(3):
            distance = math.sqrt(squared_distance(row(vertices_m, triangles[t, corner]), row(middles, t)))
            around[t] = max(around[t], distance)
    return middles, around


@building_kernel
def count_layers(start_m: FloatArray, end_m: FloatArray, vertices_m: FloatArray, triangles: IntArray) -> int:
    """Return how many triangles the segment between two points (3,) passes through."""
    p = (start_m[0], start_m[1], start_m[2])
    q = (end_m[0], end_m[1], end_m[2])
    count = 0
    for t in range(triangles.shape[0]):
        u, v, w = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        a = row(vertices_m, u)
        b = row(vertices_m, v)
        c = row(vertices_m, w)
        if where_through(p, q, a, b, c) >= 0.0:
            count += 1
    return count


@building_kernel
def nearest_segments(ends_m: FloatArray, line_m: FloatArray, out: FloatArray) -> None:
    """Write how far each of the segments (k, 2, 3) is from a line of points (n, 3) into `out` (k,), in m."""
    for i in range(ends_m.shape[0]):
        p = row_of(ends_m, i, 0)
        q = row_of(ends_m, i, 1)
        least = math.inf
        for j in range(line_m.shape[0] - 1):
            r = row(line_m, j)
            s = row(line_m, j + 1)
            least = min(least, segment_segment(p, q, r, s)[0])
        out[i] = math.sqrt(least)


@building_kernel
def nearest_strands(line_m: FloatArray, apart: int) -> float:
    """Return the least distance in m of two segments of a line (n, 3) that are at least ``apart`` segments apart."""
    least = math.inf
    for i in range(line_m.shape[0] - 1):
        p, q = row(line_m, i), row(line_m, i + 1)
        for j in range(i + apart, line_m.shape[0] - 1):
            r, s = row(line_m, j), row(line_m, j + 1)
            least = min(least, segment_segment(p, q, r, s)[0])
    return math.sqrt(least)
