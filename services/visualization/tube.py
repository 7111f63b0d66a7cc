"""The catheter's surface: rings swept along the centreline with a frame that does not twist."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from services.visualization.picture import Float32Array, IndexArray


def tube_triangles(n_rings: int, sides: int) -> IndexArray:
    """Return the triangles (2 (n - 1) s, 3) of a tube of ``n_rings`` rings, normals outwards."""
    ring, side = np.meshgrid(np.arange(n_rings - 1), np.arange(sides), indexing="ij")
    a = ring * sides + side
    b = ring * sides + (side + 1) % sides
    lower = np.stack([a, b, a + sides], axis=-1)
    upper = np.stack([b, b + sides, a + sides], axis=-1)
    return np.stack([lower, upper], axis=2).reshape(-1, 3).astype(np.int32)


@njit(cache=True, nogil=True, fastmath=False)  # type: ignore[untyped-decorator]  # numba has no types
def sweep_tube(line: Float32Array, radius: float, points: Float32Array, normals: Float32Array) -> None:
    """Write points and normals (n s, 3) of a tube round ``line`` (n, 3), carrying the frame by projection.

    The first ring's direction is any normal of the first tangent; every next ring keeps the last direction less its
    part along the new tangent, so the surface does not turn about the line.
    """
    n = line.shape[0]
    sides = points.shape[0] // n
    u = np.zeros(3)
    for i in range(n):
        before, after = line[max(i - 1, 0)], line[min(i + 1, n - 1)]
        t = _unit(after - before)
        if i == 0:
            u[0 if abs(t[0]) < 0.6 else 1] = 1.0
        u = _unit(u - (u @ t) * t)
        w = np.array([t[1] * u[2] - t[2] * u[1], t[2] * u[0] - t[0] * u[2], t[0] * u[1] - t[1] * u[0]])
        for s in range(sides):
            angle = 2.0 * np.pi * s / sides
            for k in range(3):
                normal = np.cos(angle) * u[k] + np.sin(angle) * w[k]
                normals[i * sides + s, k] = normal
                points[i * sides + s, k] = line[i, k] + radius * normal


@njit(cache=True, nogil=True, fastmath=False)  # type: ignore[untyped-decorator]  # numba has no types
def _unit(v: npt.NDArray[np.floating]) -> npt.NDArray[np.float64]:
    out = np.zeros(3)
    length = np.sqrt(float(v[0]) ** 2 + float(v[1]) ** 2 + float(v[2]) ** 2)
    if length > 0.0:
        for k in range(3):
            out[k] = v[k] / length
    return out
