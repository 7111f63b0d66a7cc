"""Surfaces swept along a line with a twist-free frame, for the catheter and surfaces of revolution."""

from __future__ import annotations

import math

import numpy as np

from trocar.services.mechanics.arrays import Float32Array, FloatArray, IntArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.vectors import along, cross, dot, row, scaled, subtract, unit


def tube_triangles(n_rings: int, sides: int) -> IntArray:
    """Return the triangles (2 (n - 1) s, 3) of a tube of ``n_rings`` rings, normals outwards."""
    ring, side = np.meshgrid(np.arange(n_rings - 1), np.arange(sides), indexing="ij")
    a = ring * sides + side
    b = ring * sides + (side + 1) % sides
    lower = np.stack([a, b, a + sides], axis=-1)
    upper = np.stack([b, b + sides, a + sides], axis=-1)
    return np.stack([lower, upper], axis=2).reshape(-1, 3).astype(np.int32)


def spline(points: FloatArray | Float32Array, per_segment: int) -> Float32Array:
    """Return a Catmull-Rom curve (``(n - 1) per_segment + 1``, 3) through `points` (n, 3)."""
    p = np.concatenate([points[:1], points, points[-1:]]).astype(float)
    a, b, c, d = (p[i : len(p) - 3 + i, None] for i in range(4))
    t = (np.arange(per_segment) / per_segment)[None, :, None]
    curve = b + 0.5 * t * ((c - a) + t * ((2 * a - 5 * b + 4 * c - d) + t * (3 * b - a - 3 * c + d)))
    return np.concatenate([curve.reshape(-1, 3), p[-1:]]).astype(np.float32)


@kernel
def sweep_tube(line: Float32Array, radii: Float32Array, points: Float32Array, normals: Float32Array) -> None:
    """Write points and normals (n s, 3) of a tube round ``line`` (n, 3) with a radius (n,) at each of its points.

    The first ring's direction is any normal of the first tangent; every next ring keeps the last direction less its
    part along the new tangent, so the surface does not turn about the line.
    """
    n = line.shape[0]
    sides = points.shape[0] // n
    u = (0.0, 0.0, 0.0)
    for i in range(n):
        t = unit(subtract(row(line, min(i + 1, n - 1)), row(line, max(i - 1, 0))))
        if i == 0:
            u = (1.0, 0.0, 0.0) if abs(t[0]) < 0.6 else (0.0, 1.0, 0.0)
        u = unit(along(u, t, -dot(u, t)))
        w = cross(t, u)
        for s in range(sides):
            angle = 2.0 * math.pi * s / sides
            normal = along(scaled(u, math.cos(angle)), w, math.sin(angle))
            for k in range(3):
                normals[i * sides + s, k] = normal[k]
                points[i * sides + s, k] = line[i, k] + radii[i] * normal[k]
