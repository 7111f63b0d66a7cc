"""Constant-strain membrane triangle with a rigid-motion-free drilling penalty.

The strain is constant, so in-plane bending locks until the mesh is fine. The element itself has no stiffness
against rotation about its normal; where all triangles round a node are coplanar the assembled matrix would be
singular. A penalty on the difference between the drilling rotation and the membrane's own rotation (after
Kanok-Nukulchai, IJNME 14:1183, 1979) removes the singularity; it vanishes in rigid motion and in any constant
strain, so zero-energy modes and the patch test are kept.
"""

from __future__ import annotations

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.fem.triangle import shape_gradients, signed_areas

DRILLING_PENALTY = 1e-3
"""Fictitious drilling stiffness relative to the in-plane shear rigidity."""


def strain_displacement(xy: FloatArray) -> FloatArray:
    """(m, 3, 9) constant strain (xx, yy, engineering xy) from (u, v, theta_z) of each node."""
    gradient = shape_gradients(xy)
    B = np.zeros((len(xy), 3, 9))
    B[:, 0, 0::3] = B[:, 2, 1::3] = gradient[:, 0]
    B[:, 1, 1::3] = B[:, 2, 0::3] = gradient[:, 1]
    return B


def stiffness(xy: FloatArray, D: FloatArray, thickness: FloatArray) -> FloatArray:
    """(m, 9, 9) membrane stiffness with the drilling penalty; see `element.StiffnessKernel`."""
    rigidity = thickness[:, None, None] * D
    area = signed_areas(xy)[:, None, None]
    B = strain_displacement(xy)
    K: FloatArray = area * (B.transpose(0, 2, 1) @ rigidity @ B)
    twist = _drilling_mismatch(xy)
    weight = DRILLING_PENALTY * rigidity[:, 2:, 2:] * area / 3.0
    return K + weight * (twist.transpose(0, 2, 1) @ twist)


def _drilling_mismatch(xy: FloatArray) -> FloatArray:
    """(m, 3, 9) rotation of each node about the normal minus the membrane's rotation (v,x - u,y) / 2."""
    gradient = shape_gradients(xy)
    C = np.zeros((len(xy), 3, 9))
    C[:, :, 0::3] = 0.5 * gradient[:, None, 1]
    C[:, :, 1::3] = -0.5 * gradient[:, None, 0]
    C[:, np.arange(3), [2, 5, 8]] = 1.0
    return C
