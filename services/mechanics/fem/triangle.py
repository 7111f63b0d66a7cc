"""Plane geometry shared by the elements."""

from __future__ import annotations

import numpy as np

from trocar.services.mechanics.arrays import FloatArray


def signed_areas(xy: FloatArray) -> FloatArray:
    """(m,) areas of (m, 3, 2) triangles, positive for counter-clockwise nodes."""
    a, b = xy[:, 1] - xy[:, 0], xy[:, 2] - xy[:, 0]
    areas: FloatArray = 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    return areas


def shape_gradients(xy: FloatArray) -> FloatArray:
    """(m, 2, 3) gradients of the three area coordinates, constant over a triangle, in 1/m."""
    opposite = np.roll(xy, -1, axis=1) - np.roll(xy, -2, axis=1)
    b, c = opposite[..., 1], -opposite[..., 0]
    gradients: FloatArray = np.stack([b, c], axis=1) / (2.0 * signed_areas(xy)[:, None, None])
    return gradients
