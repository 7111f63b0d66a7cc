"""The smooth curve of a rod: a quadratic B-spline with the particles as control points.

It connects the middles of neighbouring segments, tangent to both, and ends with straight lines to the first and the
last particle. The polygon of the particles has a kink at each of them. When a kink slides past a support, the direction
of the support's force would jump; as a step keeps the direction at its start, its error would be this jump times the
sliding distance. Along the curve the direction changes continuously.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import inlined_kernel, kernel
from trocar.services.mechanics.compiled.vectors import Vector, along, combine, dot, row, scaled, subtract

_NEWTON_STEPS = 8
_CLOSE = 1e-12  # tolerance of the position along the curve, in segments


class CurvePoint(NamedTuple):
    """The point of the curve nearest to a point in space.

    Attributes:
        first, weights: The point is the sum of three particles from ``first`` on, with these weights.
        direction: Unit tangent; zero if the nearest point is an end of the rod.
        offset: Vector from the point in space to it, in m.
    """

    first: int
    weights: Vector
    direction: Vector
    offset: Vector


@inlined_kernel
def closest_on_curve(x: FloatArray, segment: int, s: float, p: Vector) -> CurvePoint:
    """Return the point nearest to p of the curve of ``x`` (n, 3), n at least 3, by Newton's method.

    It starts at ``s`` (0 to 1) of a segment. As the offset is normal to the tangent, the gradient of the squared
    distance with respect to the particles is 2 weights x offset.
    """
    last, at = float(x.shape[0] - 1), segment + s
    for _ in range(_NEWTON_STEPS):
        offset, slope, bend = _curve_at(x, at, p)
        squared = dot(slope, slope)
        if squared == 0.0:
            break
        before = at
        # Beyond the centre of curvature the second derivative is negative: half of Gauss and Newton's bounds it.
        at -= dot(offset, slope) / max(squared + dot(offset, bend), 0.5 * squared)
        at = min(max(at, before - 1.0, 0.0), before + 1.0, last)
        if abs(at - before) < _CLOSE:
            break
    first, weights, _, _ = _weights_at(at, x.shape[0])
    offset, slope, _ = _curve_at(x, at, p)
    length = math.sqrt(dot(slope, slope))
    tangent = scaled(slope, 1.0 / length if length > 0.0 and 0.0 < at < last else 0.0)
    # The offset is made normal to the tangent: rounding errors along it would brake a sliding rod.
    return CurvePoint(first, weights, tangent, along(offset, tangent, -dot(offset, tangent)))


@kernel
def point_on_curve(x: FloatArray, at: float) -> tuple[int, Vector, Vector]:
    """Return the point of the curve of ``x`` (n, 3) at ``at`` segments, and its derivative there, in m per segment.

    The point is returned as the first of three particles and their weights.
    """
    first, weights, slope, _ = _weights_at(at, x.shape[0])
    return first, weights, combine(slope, row(x, first), row(x, first + 1), row(x, first + 2))


@kernel
def _weights_at(at: float, n: int) -> tuple[int, Vector, Vector, Vector]:
    """Return the first of three particles, and their weights in the point and its derivatives at ``at`` segments."""
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
    """Return the curve's offset from p, and its first and second derivatives by the number of segments, in m."""
    first, point, slope, bend = _weights_at(at, x.shape[0])
    a, b, c = row(x, first), row(x, first + 1), row(x, first + 2)
    return subtract(combine(point, a, b, c), p), combine(slope, a, b, c), combine(bend, a, b, c)
