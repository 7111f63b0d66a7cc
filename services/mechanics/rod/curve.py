"""The smooth curve of a rod: a quadratic B-spline with the particles as control points.

It goes from the middle of each segment to the middle of the next one, tangent to both, and straight on to the first
and the last particle. The polygon of the particles has a kink at each of them; where such a kink slides past a point
that holds it, the direction of the hold jumps. A step keeps the direction of its start, so its error would be the jump
times the distance that slides. Along this curve the direction changes continuously.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from services.mechanics.arrays import FloatArray
from services.mechanics.compiled import kernel
from services.mechanics.compiled.vectors import Vector, along, combine, dot, row, scaled, subtract

_NEWTON_STEPS = 8
_CLOSE = 1e-12  # of a segment


class CurvePoint(NamedTuple):
    """A point of the curve, and where it is seen from a point in space.

    Attributes:
        first, weights: It is the weighted sum of three particles from ``first`` on.
        direction: Unit tangent; zero at an end of the rod that is nearest itself.
        offset: From the point in space to it, in m.
    """

    first: int
    weights: Vector
    direction: Vector
    offset: Vector


@kernel
def closest_on_curve(x: FloatArray, segment: int, s: float, p: Vector) -> CurvePoint:
    """Where the curve through ``x`` (n, 3), n at least 3, is nearest to p, found from ``s`` of a segment by Newton.

    As the offset is normal to the tangent, the squared distance has the gradient 2 weights x offset in the particles.
    """
    last, at = float(x.shape[0] - 1), segment + s
    for _ in range(_NEWTON_STEPS):
        offset, slope, bend = _curve_at(x, at, p)
        squared = dot(slope, slope)
        if squared == 0.0:
            break
        before = at
        # Beyond the centre of curvature there is no nearest point along this normal: halfway to Gauss and Newton's.
        at -= dot(offset, slope) / max(squared + dot(offset, bend), 0.5 * squared)
        at = min(max(at, before - 1.0, 0.0), before + 1.0, last)
        if abs(at - before) < _CLOSE:
            break
    first, weights, _, _ = _weights_at(at, x.shape[0])
    offset, slope, _ = _curve_at(x, at, p)
    length = math.sqrt(dot(slope, slope))
    tangent = scaled(slope, 1.0 / length if length > 0.0 and 0.0 < at < last else 0.0)
    # A rod that slides must not be braked by the rounding error of the place along the curve.
    return CurvePoint(first, weights, tangent, along(offset, tangent, -dot(offset, tangent)))


@kernel
def point_on_curve(x: FloatArray, at: float) -> tuple[int, Vector, Vector]:
    """Return the point of the curve through ``x`` (n, 3) at ``at`` segments, and the slope there, in m a segment.

    The point is the sum of three particles from the first returned number on, with the returned weights.
    """
    first, weights, slope, _ = _weights_at(at, x.shape[0])
    return first, weights, combine(slope, row(x, first), row(x, first + 1), row(x, first + 2))


@kernel
def _weights_at(at: float, n: int) -> tuple[int, Vector, Vector, Vector]:
    """Return the first of three particles, and their weights in point, slope and bend at ``at`` segments."""
    if at <= 0.5:
        return 0, (1.0 - at, at, 0.0), (-1.0, 1.0, 0.0), (0.0, 0.0, 0.0)
    if at >= n - 1.5:
        u = at - (n - 1)
        return n - 3, (0.0, -u, 1.0 + u), (0.0, -1.0, 1.0), (0.0, 0.0, 0.0)
    middle = min(int(at + 0.5), n - 2)
    u = at - middle + 0.5
    point = (0.5 * (1.0 - u) ** 2, 0.5 + u - u * u, 0.5 * u * u)
    return middle - 1, point, (u - 1.0, 1.0 - 2.0 * u, u), (1.0, -2.0, 1.0)


@kernel
def _curve_at(x: FloatArray, at: float, p: Vector) -> tuple[Vector, Vector, Vector]:
    """Return the curve's offset from p, slope and bend: derivatives by the number of segments, in m."""
    first, point, slope, bend = _weights_at(at, x.shape[0])
    a, b, c = row(x, first), row(x, first + 1), row(x, first + 2)
    return subtract(combine(point, a, b, c), p), combine(slope, a, b, c), combine(bend, a, b, c)
