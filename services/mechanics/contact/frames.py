"""Orthonormal frames on a contact normal."""

from __future__ import annotations

import math

from services.mechanics.arrays import FloatArray
from services.mechanics.compiled import kernel

Direction = tuple[float, float, float]


@kernel
def tangents(x: float, y: float, z: float) -> tuple[Direction, Direction]:
    """Return two directions that complete the unit vector (x, y, z) to an orthonormal frame.

    Duff et al., "Building an orthonormal basis, revisited", JCGT 6(1), 2017: continuous but at z = 0-.
    """
    sign = math.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    return (1.0 + sign * x * x * a, sign * b, -sign * x), (b, sign + y * y * a, -y)


@kernel
def write_frame(normal: FloatArray, out: FloatArray) -> None:
    """Complete a unit normal (3,) to an orthonormal frame in the rows of ``out`` (3, 3)."""
    x, y, z = normal[0], normal[1], normal[2]
    first, second = tangents(x, y, z)
    out[0, 0], out[0, 1], out[0, 2] = x, y, z
    for axis in range(3):
        out[1, axis], out[2, axis] = first[axis], second[axis]
