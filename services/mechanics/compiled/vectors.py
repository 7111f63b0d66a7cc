"""Vectors of kernels: tuples of three numbers, which stay in registers, so that nothing is allocated."""

from __future__ import annotations

import math

from trocar.services.mechanics.arrays import Float32Array, FloatArray
from trocar.services.mechanics.compiled import kernel

Vector = tuple[float, float, float]


@kernel
def subtract(u: Vector, v: Vector) -> Vector:
    """Return u - v."""
    return (u[0] - v[0], u[1] - v[1], u[2] - v[2])


@kernel
def along(u: Vector, v: Vector, factor: float) -> Vector:
    """Return u + factor v."""
    return (u[0] + factor * v[0], u[1] + factor * v[1], u[2] + factor * v[2])


@kernel
def dot(u: Vector, v: Vector) -> float:
    """Return u . v."""
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


@kernel
def cross(u: Vector, v: Vector) -> Vector:
    """Return u x v."""
    return (u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0])


@kernel
def scaled(u: Vector, factor: float) -> Vector:
    """Return factor u."""
    return (factor * u[0], factor * u[1], factor * u[2])


@kernel
def unit(u: Vector) -> Vector:
    """Return u scaled to length one, or zero where u is zero."""
    length = math.sqrt(dot(u, u))
    return scaled(u, 1.0 / length) if length > 0.0 else u


@kernel
def squared_distance(u: Vector, v: Vector) -> float:
    """Return |u - v|^2."""
    d = subtract(u, v)
    return dot(d, d)


@kernel
def combine(w: Vector, a: Vector, b: Vector, c: Vector) -> Vector:
    """Return w0 a + w1 b + w2 c."""
    return (
        w[0] * a[0] + w[1] * b[0] + w[2] * c[0],
        w[0] * a[1] + w[1] * b[1] + w[2] * c[1],
        w[0] * a[2] + w[1] * b[2] + w[2] * c[2],
    )


@kernel
def between(u: Vector, v: Vector, share: float) -> Vector:
    """Return (1 - share) u + share v."""
    return along(scaled(u, 1.0 - share), v, share)


@kernel
def row(array: FloatArray | Float32Array, i: int) -> Vector:
    """Return row i of an (n, 3) array as a tuple, which stays in registers."""
    return (array[i, 0], array[i, 1], array[i, 2])


@kernel
def row_of(array: FloatArray | Float32Array, i: int, k: int) -> Vector:
    """Return entry k of row i of an (n, m, 3) array as a tuple."""
    return (array[i, k, 0], array[i, k, 1], array[i, k, 2])


@kernel
def put_row(array: FloatArray, i: int, v: Vector) -> None:
    """Write v into row i of an (n, 3) array."""
    for axis in range(3):
        array[i, axis] = v[axis]


@kernel
def copy_rows(source: FloatArray, target: FloatArray, count: int) -> None:
    """Copy the first ``count`` rows of an (n, 3) array, without the memory that an assignment of slices takes."""
    for i in range(count):
        put_row(target, i, row(source, i))


@kernel
def put_row_of(array: FloatArray, i: int, k: int, v: Vector) -> None:
    """Write v into entry k of row i of an (n, m, 3) array."""
    for axis in range(3):
        array[i, k, axis] = v[axis]


@kernel
def tangents(x: float, y: float, z: float) -> tuple[Vector, Vector]:
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
