"""Candidates: the closest points of every piece and triangle within reach, and the unsigned normal between them.

A piece is a capsule: a segment of a tool or of the catheter, or a sphere if its ends coincide. Triangles include their
edges, vertices and rims. A piece parallel to a triangle is near it at several points: at its ends and at edges. Points
about as near as the closest pair are further candidates. With one candidate per triangle, the contact of a jaw across
two edges would alternate between them, and a catheter's tip would not come to rest next to an edge.

The normal points from the wall's middle surface to the piece's axis, on whichever side that is. The side never changes,
because axes never cross the middle surface.
"""

from __future__ import annotations

import math
from typing import Annotated

from trocar.services.mechanics.arrays import FloatArray, IntArray, LongArray
from trocar.services.mechanics.collision.candidate_list import CandidateList, list_near, store_distance
from trocar.services.mechanics.collision.clusters import centroid, vector_from_segment
from trocar.services.mechanics.collision.primitives import (
    Places,
    closest_places,
    closest_segment_triangle,
    parameter_on_segment,
)
from trocar.services.mechanics.compiled import inlined_kernel, kernel
from trocar.services.mechanics.compiled.struct import Struct, reader
from trocar.services.mechanics.compiled.vectors import (
    Vector,
    along,
    combine,
    cross,
    dot,
    put_row,
    row,
    row_of,
    scaled,
    squared_distance,
    subtract,
    unit,
)

Where = tuple[FloatArray, FloatArray]
"""Ends of the pieces (p, 2, 3) and positions of the wall's nodes (n, 3), both at the same time."""

#: Distance of an axis from the middle surface below which no normal is defined.
_NO_NORMAL_M = 1e-12
#: Distance within which two points are the same, as a fraction of the axis's distance from the wall in contact: there a
#: round body has left its tangent by 1/5000 of its radius.
SAME_POINT = 0.02


class Candidates(Struct):
    """Closest pairs, of which the first ``count`` are valid."""

    piece: Annotated[LongArray, "c"]
    triangle: Annotated[LongArray, "c"]
    s: Annotated[FloatArray, "c"]  # parameter of the point on the piece's axis, 0 to 1
    weight: Annotated[FloatArray, "c", 3]  # barycentric
    normal: Annotated[FloatArray, "c", 3]  # unit vector from the wall to the piece
    gap_m: Annotated[FloatArray, "c"]  # between the surfaces, negative where they overlap
    count: int = 0
    dropped: int = 0


candidates_at = reader(Candidates)


@kernel
def write_closest(found: CandidateList, out: Candidates) -> None:
    """Write the closest pairs of listed entries whose gap is at most ``wanted`` of the piece."""
    out.count = 0
    for p in range(found.count.shape[0]):
        most = list_near(found, p)
        for place in range(found.near_count[p]):
            k = found.near[p, place]
            if found.bound[p, k] <= most:
                _measure_entry(found, p, k, out)


@inlined_kernel
def _measure_entry(found: CandidateList, p: int, k: int, out: Candidates) -> None:
    t, where, reach = found.entry[p, k], (found.ends, found.position), found.thickness[p] + found.wanted[p]
    least = _projected_distance(where, found.clusters.triangles, p, t)
    if least > reach:
        store_distance(found, p, k, least)
        return
    distance, s, w, normal, places = closest_pair(where, found.clusters.triangles, (p, t))
    store_distance(found, p, k, distance)
    if distance <= reach:
        put(out, (p, t), (distance - found.thickness[p], s, w, normal))
        if found.along_m >= 0.0:
            _put_further_minima(found, (p, t), places, (min(distance + found.along_m, reach), s), out)


@inlined_kernel
def _projected_distance(where: Where, corner: IntArray, p: int, t: int) -> float:
    """Return a lower bound, in m, on the distance of piece p and triangle t: that of their projections on a line.

    The line goes from the piece's point nearest to the middle of the triangle to this middle, so that no point of the
    piece is further along it. Projections of convex bodies are never further apart than the bodies.
    """
    u, v, w = _corners(where, corner, t)
    middle = centroid(u, v, w)
    line = vector_from_segment(row_of(where[0], p, 0), row_of(where[0], p, 1), middle)
    nearest = min(dot(subtract(u, middle), line), dot(subtract(v, middle), line), dot(subtract(w, middle), line))
    length = math.sqrt(dot(line, line))
    return length + nearest / length if length > 0.0 else 0.0


@inlined_kernel
def _put_further_minima(
    found: CandidateList, place: tuple[int, int], places: Places, closest: tuple[float, float], out: Candidates
) -> None:
    """Write further local minima of the distance of a piece and a triangle, each separate from all nearer ones.

    ``closest`` is (largest distance in m, parameter of the closest pair).
    """
    p, (limit, s_closest), corner = place[0], closest, found.clusters.triangles
    a, b = row_of(found.ends, p, 0), row_of(found.ends, p, 1)
    separation = SAME_POINT * found.thickness[p] / max(math.sqrt(squared_distance(a, b)), _NO_NORMAL_M)
    for k in range(5):
        d2, s, w = places[k]
        is_other = _NO_NORMAL_M**2 < d2 <= limit * limit and abs(s - s_closest) > separation
        for j in range(5):
            is_nearer = places[j][0] < d2 or (places[j][0] == d2 and j < k)
            is_other = is_other and not (is_nearer and abs(s - places[j][1]) <= separation)
        if is_other:
            distance = math.sqrt(d2)
            normal = scaled(offset((found.ends, found.position), corner, place, s, w), 1.0 / distance)
            put(out, place, (distance - found.thickness[p], s, w, normal))


@kernel
def put(out: Candidates, place: tuple[int, int], pair: tuple[float, float, Vector, Vector]) -> None:
    """Append a candidate: ``place`` is (piece, triangle), ``pair`` is (gap in m, parameter, weights, normal)."""
    if out.count == out.gap_m.shape[0]:
        out.dropped += 1
        return
    at = out.count
    out.piece[at], out.triangle[at] = place
    out.gap_m[at], out.s[at] = pair[0], pair[1]
    put_row(out.weight, at, pair[2])
    put_row(out.normal, at, pair[3])
    out.count += 1


@kernel
def _corners(where: Where, corner: IntArray, t: int) -> tuple[Vector, Vector, Vector]:
    return row(where[1], corner[t, 0]), row(where[1], corner[t, 1]), row(where[1], corner[t, 2])


@kernel
def closest_pair(where: Where, corner: IntArray, place: tuple[int, int]) -> tuple[float, float, Vector, Vector, Places]:
    """Return the distance (m) of a piece and a triangle, parameter, weights, normal and all of `closest_places`.

    ``place`` is (piece, triangle).
    """
    a, b = row_of(where[0], place[0], 0), row_of(where[0], place[0], 1)
    c0, c1, c2 = corners = _corners(where, corner, place[1])
    places = closest_places(a, b, c0, c1, c2)
    d2, s, w = closest_segment_triangle(a, b, corners, places)
    distance = math.sqrt(d2)
    if distance > _NO_NORMAL_M:
        return distance, s, w, scaled(offset(where, corner, place, s, w), 1.0 / distance), places
    return distance, s, w, unit(cross(subtract(c1, c0), subtract(c2, c0))), places


@kernel
def offset(where: Where, corner: IntArray, place: tuple[int, int], s: float, w: Vector) -> Vector:
    """Return the vector from a point of a triangle to a point of a piece's axis; ``place`` is (piece, triangle)."""
    p, t = place
    c0, c1, c2 = _corners(where, corner, t)
    a, b = row_of(where[0], p, 0), row_of(where[0], p, 1)
    return subtract(along(a, subtract(b, a), s), combine(w, c0, c1, c2))


@kernel
def nearest_to(where: Where, corner: IntArray, place: tuple[int, int], w: Vector) -> tuple[float, Vector]:
    """Return the parameter on a piece nearest to the point of a triangle at weights ``w``, and the normal there."""
    a, b = row_of(where[0], place[0], 0), row_of(where[0], place[0], 1)
    s = parameter_on_segment(subtract(a, offset(where, corner, place, 0.0, w)), (a, b))
    return s, unit(offset(where, corner, place, s, w))
