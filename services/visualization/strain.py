"""The duct coloured by its largest stretch, as the page does (`web/src/view/strain.js`)."""

from __future__ import annotations

import numpy as np

from trocar.services.mechanics.arrays import Float32Array, FloatArray, IntArray
from trocar.services.visualization.tissue import Bytes

FULL = 0.2
"""Strain at the end of the scale, as the page's (`strain.js`)."""
_STOPS = 255.0 * np.array([[0.16, 0.2, 0.42], [0.13, 0.57, 0.55], [0.99, 0.9, 0.15], [0.86, 0.16, 0.12]])


def colours_of_strain(strain: FloatArray) -> Bytes:
    """Return the colour (n, 3) of each strain (n,): blue, green, yellow, red."""
    at = np.clip(strain / FULL, 0.0, 1.0) * (len(_STOPS) - 1)
    return np.stack([np.interp(at, range(len(_STOPS)), stop) for stop in _STOPS.T], axis=1).astype(np.uint8)


class Strain:
    """Strains of a surface from its rest shape, with points (n, 3) and triangles (t, 3)."""

    def __init__(self, rest_m: Float32Array, triangles: IntArray) -> None:
        self._triangles = triangles
        self._count = np.maximum(np.bincount(triangles.ravel(), minlength=len(rest_m)), 1)
        length, skew, height = _flat(rest_m, triangles)
        self._undo = np.array([[1.0 / length, -skew / (length * height)], [0.0 * length, 1.0 / height]]).transpose(
            2, 0, 1
        )

    def at(self, points_m: Float32Array) -> FloatArray:
        """Return the largest principal strain (n,) at each point, the mean over its triangles."""
        length, skew, height = _flat(points_m, self._triangles)
        gradient = np.array([[length, skew], [0.0 * length, height]]).transpose(2, 0, 1) @ self._undo
        stretch = np.linalg.norm(gradient, ord=2, axis=(1, 2)) - 1.0
        total = np.bincount(self._triangles.ravel(), np.repeat(stretch, 3), minlength=len(points_m))
        strain: FloatArray = total / self._count
        return strain


def _flat(points_m: Float32Array, triangles: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return each triangle's first edge length, and the components of the second edge along and across it."""
    a, b, c = points_m[triangles.T].astype(float)
    u, v = b - a, c - a
    length = np.maximum(np.linalg.norm(u, axis=1), 1e-12)
    skew = np.sum(u * v, axis=1) / length
    return length, skew, np.sqrt(np.maximum(np.sum(v * v, axis=1) - skew**2, 1e-24))
