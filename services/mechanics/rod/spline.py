"""A smooth curve through the particles, for drawing."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from services.mechanics.arrays import FloatArray


def smooth_centreline(position_m: FloatArray, points_per_segment: int = 4) -> tuple[FloatArray, FloatArray]:
    """Return points and unit tangents, (k, 3) each, on a curve through n particles, k = (n - 1) points_per_segment + 1.

    A natural cubic spline over the chord length: its curvature is continuous, so that highlights on the drawn tube do
    not show the segments. Passes through every particle. For 30 Hz: it allocates.

    Raises
    ------
    ValueError
        Two neighbouring particles coincide.
    """
    chord = np.linalg.norm(np.diff(position_m, axis=0), axis=1)
    if not np.all(chord > 0.0):
        raise ValueError(f"particles {int(np.argmin(chord))} and {int(np.argmin(chord)) + 1} of the rod coincide")
    knots = np.concatenate(([0.0], np.cumsum(chord)))
    steps = np.arange((len(position_m) - 1) * points_per_segment + 1) / points_per_segment
    at = np.interp(steps, np.arange(len(knots)), knots)
    spline = CubicSpline(knots, position_m, bc_type="natural")
    tangent = spline(at, 1)
    return spline(at), tangent / np.linalg.norm(tangent, axis=1)[:, None]
