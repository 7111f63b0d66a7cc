"""Felippa's optimal membrane triangle with drilling freedoms (ANDES template).

C. A. Felippa, "A study of optimal membrane triangles with drilling freedoms", CMAME 192:2125 (2003):
K = L D L^T / V + 3/4 beta0 T^T K_theta T, with alpha_b = 3/2 and the optimal beta1..beta9. The basic part alone
passes the patch test; the higher-order part is scaled so that in-plane bending of rectangular mesh units is exact
at any aspect ratio, where the constant-strain triangle locks.

On a curved wall the drilling freedoms meet the bending of tilted neighbours: torsion of thick tubes comes out too
stiff by a part that depends on the cells' shape and not on their number, and forces on the vertices of a curved rim
bend it as if they acted beside the wall, by a part of its thickness that shrinks with the square of the edges
(`fem.facets`).
"""

from __future__ import annotations

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.fem.triangle import signed_areas

# The optimal values, by which in-plane bending is exact (Felippa, 2003):
ALPHA_B = 1.5
BETA = np.array([1.0, 2.0, 1.0, 0.0, 1.0, -1.0, -1.0, -1.0, -2.0])
# Rows: natural strains along sides 21, 32, 13; columns: hierarchical rotations at corners 1, 2, 3.
Q1_PATTERN = BETA.reshape(3, 3)
Q2_PATTERN = np.array([[BETA[8], BETA[6], BETA[7]], [BETA[2], BETA[0], BETA[1]], [BETA[5], BETA[3], BETA[4]]])
Q3_PATTERN = np.array([[BETA[4], BETA[5], BETA[3]], [BETA[7], BETA[8], BETA[6]], [BETA[1], BETA[2], BETA[0]]])


def stiffness(xy: FloatArray, D: FloatArray, thickness: FloatArray) -> FloatArray:
    """(m, 9, 9) membrane stiffness with true drilling freedoms; see `element.StiffnessKernel`."""
    rigidity = thickness[:, None, None] * D
    area = signed_areas(xy)[:, None, None]
    L = _force_lumping(xy)
    basic = L @ rigidity @ L.transpose(0, 2, 1) / area
    T = _hierarchical_rotations(xy)
    return basic + T.transpose(0, 2, 1) @ _rotational_stiffness(xy, rigidity) @ T


def _differences(xy: FloatArray) -> tuple[FloatArray, FloatArray]:
    """x_ij and y_ij as (m, 3, 3) arrays indexed by nodes i and j."""
    d = xy[:, :, None, :] - xy[:, None, :, :]
    return d[..., 0], d[..., 1]


def _force_lumping(xy: FloatArray) -> FloatArray:
    """(m, 9, 3) L per unit thickness: constant stress to node forces and drilling moments."""
    x, y = _differences(xy)
    L = np.zeros((len(xy), 9, 3))
    for j in range(3):
        k, i = (j + 1) % 3, (j + 2) % 3
        L[:, 3 * j, 0] = L[:, 3 * j + 1, 2] = 0.5 * y[:, k, i]
        L[:, 3 * j + 1, 1] = L[:, 3 * j, 2] = 0.5 * x[:, i, k]
        L[:, 3 * j + 2, 0] = ALPHA_B / 12.0 * (y[:, j, i] ** 2 - y[:, j, k] ** 2)
        L[:, 3 * j + 2, 1] = ALPHA_B / 12.0 * (x[:, j, i] ** 2 - x[:, j, k] ** 2)
        L[:, 3 * j + 2, 2] = ALPHA_B / 6.0 * (x[:, j, k] * y[:, j, k] - x[:, j, i] * y[:, j, i])
    return L


def _hierarchical_rotations(xy: FloatArray) -> FloatArray:
    """(m, 3, 9) drilling rotations less the rotation of the linear displacement field."""
    x, y = _differences(xy)
    four_area = 4.0 * signed_areas(xy)
    T = np.zeros((len(xy), 3, 9))
    for j in range(3):
        k, i = (j + 1) % 3, (j + 2) % 3
        T[:, :, 3 * j] = (x[:, i, k] / four_area)[:, None]
        T[:, :, 3 * j + 1] = (y[:, i, k] / four_area)[:, None]
        T[:, j, 3 * j + 2] = 1.0
    return T


def _rotational_stiffness(xy: FloatArray, rigidity: FloatArray) -> FloatArray:
    """(m, 3, 3) 3/4 beta0 K_theta, integrated with the three mid-side points."""
    area = signed_areas(xy)[:, None, None]
    sides = np.stack([xy[:, 1] - xy[:, 0], xy[:, 2] - xy[:, 1], xy[:, 0] - xy[:, 2]], axis=1)
    per_side = (2.0 / 3.0) * area / np.sum(sides**2, axis=2)[:, :, None]
    Q1, Q2, Q3 = (per_side * pattern for pattern in (Q1_PATTERN, Q2_PATTERN, Q3_PATTERN))
    to_cartesian = np.linalg.inv(_natural_from_cartesian(sides))
    natural = to_cartesian.transpose(0, 2, 1) @ rigidity @ to_cartesian
    K = np.zeros_like(natural)
    for Q in (0.5 * (Q1 + Q2), 0.5 * (Q2 + Q3), 0.5 * (Q3 + Q1)):
        K += Q.transpose(0, 2, 1) @ natural @ Q
    return 0.75 * _beta0(rigidity)[:, None, None] * area * K


def _natural_from_cartesian(sides: FloatArray) -> FloatArray:
    """(m, 3, 3) strain along each side from (xx, yy, engineering xy)."""
    c, s = (sides / np.linalg.norm(sides, axis=2, keepdims=True)).transpose(2, 0, 1)
    return np.stack([c * c, s * s, c * s], axis=2)


def _beta0(rigidity: FloatArray) -> FloatArray:
    """(m,) scale of the higher-order stiffness, max((1 - 4 nu²) / 2, 0.01); nu² is nu12 nu21 if orthotropic."""
    nu_squared = rigidity[:, 0, 1] ** 2 / (rigidity[:, 0, 0] * rigidity[:, 1, 1])
    beta0: FloatArray = np.maximum(0.5 * (1.0 - 4.0 * nu_squared), 0.01)
    return beta0
