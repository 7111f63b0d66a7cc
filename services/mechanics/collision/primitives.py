"""Narrow phase: closest points of points, segments and triangles.

The closest point on a triangle and the closest points of two segments are those of Ericson, "Real-Time Collision
Detection" (2005), sections 5.1.5 and 5.1.9. Barycentric weights are exactly zero if the closest point lies on an edge
or a corner, so they identify the feature.
"""

from __future__ import annotations

from trocar.services.mechanics.compiled import inlined_kernel, kernel
from trocar.services.mechanics.compiled.vectors import Vector, along, combine, cross, dot, squared_distance, subtract

Place = tuple[float, float, Vector]
"""A point of a segment and a point of a triangle: squared distance, parameter s, and barycentric weights."""
Places = tuple[Place, Place, Place, Place, Place]


@kernel
def closest_on_triangle(p: Vector, a: Vector, b: Vector, c: Vector) -> Vector:
    """Return the barycentric weights of the point of triangle abc that is closest to p."""
    ab, ac, ap = subtract(b, a), subtract(c, a), subtract(p, a)
    d1, d2 = dot(ab, ap), dot(ac, ap)
    if d1 <= 0.0 and d2 <= 0.0:
        return (1.0, 0.0, 0.0)
    bp = subtract(p, b)
    d3, d4 = dot(ab, bp), dot(ac, bp)
    if d3 >= 0.0 and d4 <= d3:
        return (0.0, 1.0, 0.0)
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        v = d1 / (d1 - d3) if d1 > d3 else 0.0
        return (1.0 - v, v, 0.0)
    cp = subtract(p, c)
    d5, d6 = dot(ab, cp), dot(ac, cp)
    if d6 >= 0.0 and d5 <= d6:
        return (0.0, 0.0, 1.0)
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        w = d2 / (d2 - d6) if d2 > d6 else 0.0
        return (1.0 - w, 0.0, w)
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and d4 >= d3 and d5 >= d6:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return (0.0, 1.0 - w, w)
    scale = 1.0 / (va + vb + vc)
    return (va * scale, vb * scale, vc * scale)


@kernel
def clamp01(x: float) -> float:
    """Return x limited to 0..1."""
    return min(max(x, 0.0), 1.0)


@kernel
def closest_of_segments(p1: Vector, q1: Vector, p2: Vector, q2: Vector) -> tuple[float, float, float]:
    """Return (s, t, squared distance) of the closest points p1 + s (q1 - p1) and p2 + t (q2 - p2)."""
    d1, d2, r = subtract(q1, p1), subtract(q2, p2), subtract(p1, p2)
    a, e, f, c, b = dot(d1, d1), dot(d2, d2), dot(d2, r), dot(d1, r), dot(d1, d2)
    if a <= 0.0 and e <= 0.0:
        return (0.0, 0.0, dot(r, r))
    if a <= 0.0:
        s, t = 0.0, clamp01(f / e)
    elif e <= 0.0:
        s, t = clamp01(-c / a), 0.0
    else:
        denominator = a * e - b * b
        # If they are parallel within rounding, any s of the overlap is closest; the clamps below select one.
        s = clamp01((b * f - c * e) / denominator) if denominator > 1e-14 * a * e else 0.5
        t = (b * s + f) / e
        if t < 0.0:
            s, t = clamp01(-c / a), 0.0
        elif t > 1.0:
            s, t = clamp01((b - c) / a), 1.0
        elif denominator <= 1e-14 * a * e:
            s = clamp01((b * t - c) / a)
    gap = subtract(along(p1, d1, s), along(p2, d2, t))
    return (s, t, dot(gap, gap))


@kernel
def segment_pierces(p: Vector, q: Vector, a: Vector, b: Vector, c: Vector) -> tuple[bool, float, Vector]:
    """Return whether segment pq intersects triangle abc, the parameter s there, and the barycentric weights there."""
    ab, ac, pq = subtract(b, a), subtract(c, a), subtract(q, p)
    n = cross(ab, ac)
    descent, ap = -dot(pq, n), subtract(p, a)
    s = dot(ap, n) / descent
    if not 0.0 <= s <= 1.0:  # infinite, or no number, if they are parallel
        return (False, 0.0, (1.0, 0.0, 0.0))
    e = cross(ap, pq)
    v, w = dot(ac, e) / descent, -dot(ab, e) / descent
    if v < 0.0 or w < 0.0 or v + w > 1.0:
        return (False, 0.0, (1.0, 0.0, 0.0))
    return (True, s, (1.0 - v - w, v, w))


@inlined_kernel
def closest_places(p: Vector, q: Vector, a: Vector, b: Vector, c: Vector) -> Places:
    """Return the closest pairs of both ends of pq with triangle abc, and of pq with each edge.

    One of them is the closest pair of pq and abc, unless pq intersects the triangle.
    """
    u, v = closest_on_triangle(p, a, b, c), closest_on_triangle(q, a, b, c)
    return (
        (squared_distance(p, combine(u, a, b, c)), 0.0, u),
        (squared_distance(q, combine(v, a, b, c)), 1.0, v),
        _closest_to_edge(p, q, 0, (a, b)),
        _closest_to_edge(p, q, 1, (b, c)),
        _closest_to_edge(p, q, 2, (c, a)),
    )


@kernel
def _closest_to_edge(p: Vector, q: Vector, k: int, ends: tuple[Vector, Vector]) -> Place:
    """Return the closest pair of a segment and edge k of triangle abc: ab, bc or ca."""
    s, t, d2 = closest_of_segments(p, q, ends[0], ends[1])
    return d2, s, ((1.0 - t, t, 0.0) if k == 0 else (0.0, 1.0 - t, t) if k == 1 else (t, 0.0, 1.0 - t))


@inlined_kernel
def closest_segment_triangle(p: Vector, q: Vector, corners: tuple[Vector, Vector, Vector], places: Places) -> Place:
    """Return the closest pair of segment pq and a triangle, at distance 0 if they intersect; see `closest_places`."""
    meets, s, w = segment_pierces(p, q, corners[0], corners[1], corners[2])
    if meets:
        return 0.0, s, w
    best = places[0]
    for k in range(1, 5):
        if places[k][0] < best[0]:
            best = places[k]
    return best


@kernel
def parameter_on_segment(point: Vector, ends: tuple[Vector, Vector]) -> float:
    """Return the parameter, 0 to 1, of the point on the segment between ``ends`` that is closest to a point."""
    axis = subtract(ends[1], ends[0])
    length_2 = dot(axis, axis)
    return clamp01(dot(subtract(point, ends[0]), axis) / length_2) if length_2 > 0.0 else 0.0
