"""Discrete Kirchhoff triangle for thin-plate bending.

Batoz, Bathe and Ho, IJNME 15:1771 (1980): rotations of the normal vary quadratically, transverse shear is zero at
the corners and along the sides, and the deflection is cubic along each side. Passes the patch test with constant
curvature including twist; transverse shear flexibility is absent, so the wall must be thin.
"""

from __future__ import annotations

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.fem.triangle import shape_gradients, signed_areas

# Values at the three mid-side points of d N_a / d L_k for the six quadratic shape functions N_a in area coordinates:
# corners L_a (2 L_a - 1), then mid-sides 4 L_i L_j of sides 12, 23, 31.
MIDSIDE_POINTS = np.array([[0.5, 0.5, 0.0], [0.0, 0.5, 0.5], [0.5, 0.0, 0.5]])
SIDES = ((0, 1), (1, 2), (2, 0))


def stiffness(xy: FloatArray, D: FloatArray, thickness: FloatArray) -> FloatArray:
    """(m, 9, 9) bending stiffness; see `element.StiffnessKernel`.

    The curvature is linear over the triangle, so the three mid-side points integrate its energy exactly.
    """
    rigidity = thickness[:, None, None] ** 3 / 12.0 * D
    weight = signed_areas(xy)[:, None, None] / 3.0
    K = np.zeros((len(xy), 9, 9))
    for B in curvature_displacement(xy, normal_rotations(xy)):
        K += weight * (B.transpose(0, 2, 1) @ rigidity @ B)
    return K


def curvature_displacement(xy: FloatArray, beta: FloatArray) -> list[FloatArray]:
    """Three (m, 3, 9) matrices, one a mid-side: the curvature (xx, yy, 2 xy) of the rotations `normal_rotations`."""
    gradient = shape_gradients(xy)
    matrices = []
    for point in MIDSIDE_POINTS:
        dN = gradient @ _quadratic_derivatives(point)
        B = np.empty((len(xy), 3, 9))
        B[:, 0] = np.einsum("ma,mad->md", dN[:, 0], beta[:, :, 0])
        B[:, 1] = np.einsum("ma,mad->md", dN[:, 1], beta[:, :, 1])
        B[:, 2] = np.einsum("ma,mad->md", dN[:, 1], beta[:, :, 0])
        B[:, 2] += np.einsum("ma,mad->md", dN[:, 0], beta[:, :, 1])
        matrices.append(B)
    return matrices


def _quadratic_derivatives(point: FloatArray) -> FloatArray:
    """(3, 6) derivative of the quadratic shape functions with respect to each area coordinate."""
    derivative = np.zeros((3, 6))
    derivative[np.arange(3), np.arange(3)] = 4.0 * point - 1.0
    for side, (i, j) in enumerate(SIDES):
        derivative[i, 3 + side] = 4.0 * point[j]
        derivative[j, 3 + side] = 4.0 * point[i]
    return derivative


def normal_rotations(xy: FloatArray) -> FloatArray:
    """(m, 6, 2, 9) beta = -grad w at corners and mid-sides from (w, theta_x, theta_y) of the corners.

    Along a side the deflection is cubic, which gives the mid-side slope along it; across it the rotation is the
    mean of the two corners.
    """
    beta = np.zeros((len(xy), 6, 2, 9))
    for corner in range(3):
        beta[:, corner, 0, 3 * corner + 2] = 1.0
        beta[:, corner, 1, 3 * corner + 1] = -1.0
    for side, (i, j) in enumerate(SIDES):
        along = xy[:, j] - xy[:, i]
        length = np.linalg.norm(along, axis=1, keepdims=True)
        tangent = along / length
        mean = 0.5 * np.eye(2) - 0.75 * tangent[:, :, None] * tangent[:, None, :]
        beta[:, 3 + side] = mean @ (beta[:, i] + beta[:, j])
        beta[:, 3 + side, :, 3 * i] += 1.5 * tangent / length
        beta[:, 3 + side, :, 3 * j] -= 1.5 * tangent / length
    return beta
