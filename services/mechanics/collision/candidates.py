"""Candidates: the closest pair of every piece and triangle that are within reach, and the unsigned normal between them.

A piece is a capsule (a segment of a tool, of the catheter; a sphere where its ends are one point). Edges, vertices and
rims come with the triangles. The normal points from the wall's middle surface to the piece's axis, whichever side it is
on: what is guaranteed is that axes never cross the middle surface, so that the side never changes.
"""

from __future__ import annotations

import math
from typing import Annotated

from services.mechanics.arrays import FloatArray, IntArray, LongArray
from services.mechanics.collision.candidate_list import CandidateList, is_within, list_at, note_distance
from services.mechanics.collision.primitives import closest_segment_triangle
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address, Struct, reader
from services.mechanics.compiled.vectors import (
    Vector,
    along,
    combine,
    cross,
    put_row,
    row,
    row_of,
    scaled,
    subtract,
    unit,
)

Where = tuple[FloatArray, FloatArray]
"""Ends of the pieces (p, 2, 3) and nodes of the wall (n, 3), both at one moment."""

#: Below this distance of an axis from the middle surface a normal is noise.
_TOUCHING_M = 1e-12


class Candidates(Struct):
    """Closest pairs; the first ``count`` mean anything.

    Attributes
    ----------
    piece, triangle : (c,) int64
    s : (c,) float64
        Place along the piece's axis, 0 to 1.
    weight : (c, 3) float64
        Barycentric weights in the triangle.
    normal : (c, 3) float64
        Unit vector from the wall to the piece.
    gap_m : (c,) float64
        Between the surfaces; negative where they overlap.
    """

    piece: Annotated[LongArray, "c"]
    triangle: Annotated[LongArray, "c"]
    s: Annotated[FloatArray, "c"]
    weight: Annotated[FloatArray, "c", 3]
    normal: Annotated[FloatArray, "c", 3]
    gap_m: Annotated[FloatArray, "c"]
    count: int = 0
    dropped: int = 0


candidates_at = reader(Candidates)


@kernel
def measure(address: Address[CandidateList], out_address: Address[Candidates], span: tuple[int, int]) -> None:
    """Write the closest pairs of listed entries that are as near as is wanted, of pieces in a span."""
    found, out = list_at(address), candidates_at(out_address)
    out.count = 0
    for p in range(span[0], span[1]):
        for k in range(found.count[p]):
            if is_within(found, p, k):
                _measure_entry(found, p, k, out)


@kernel
def _measure_entry(found: CandidateList, p: int, k: int, out: Candidates) -> None:
    t = found.entry[p, k]
    distance, s, w, normal = closest_pair((found.ends, found.position), found.clusters.triangles, p, t)
    note_distance(found, p, k, distance)
    gap = distance - found.thickness[p]
    if gap > found.wanted[p]:
        return
    if out.count == out.gap_m.shape[0]:
        out.dropped += 1
        return
    at = out.count
    out.piece[at], out.triangle[at], out.s[at], out.gap_m[at] = p, t, s, gap
    put_row(out.weight, at, w)
    put_row(out.normal, at, normal)
    out.count += 1


@kernel
def closest_pair(where: Where, corner: IntArray, p: int, t: int) -> tuple[float, float, Vector, Vector]:
    """Return distance, place along the piece, weights in the triangle and normal of a piece and a triangle."""
    a, b = row_of(where[0], p, 0), row_of(where[0], p, 1)
    c0, c1, c2 = row(where[1], corner[t, 0]), row(where[1], corner[t, 1]), row(where[1], corner[t, 2])
    d2, s, w = closest_segment_triangle(a, b, c0, c1, c2)
    away = subtract(along(a, subtract(b, a), s), combine(w, c0, c1, c2))
    distance = math.sqrt(d2)
    if distance > _TOUCHING_M:
        return distance, s, w, scaled(away, 1.0 / distance)
    return distance, s, w, unit(cross(subtract(c1, c0), subtract(c2, c0)))


@kernel
def offset(where: Where, corner: IntArray, place: tuple[int, int], s: float, w: Vector) -> Vector:
    """Return the vector from a point of a triangle to a point of a piece's axis; ``place`` are piece and triangle."""
    p, t = place
    c0, c1, c2 = row(where[1], corner[t, 0]), row(where[1], corner[t, 1]), row(where[1], corner[t, 2])
    a, b = row_of(where[0], p, 0), row_of(where[0], p, 1)
    return subtract(along(a, subtract(b, a), s), combine(w, c0, c1, c2))
