r"""Discrete Kirchhoff-Mindlin triangle: bending of a plate that also gives way to transverse shear.

Katili, IJNME 36:1859 (1993): the discrete Kirchhoff triangle whose rotations along each side need not follow the slope.
What a side lacks is its shear strain, constant along it, by the moment that bends the side, so nothing locks: as the
plate gets thin, this is `dkt`. Shear stress is taken as parabolic over the thickness.

A wall that is pressed on its faces gives way less: there the load does not bear on the middle surface, but spreads on
its way to it. By Reissner's theory (Journal of Applied Mechanics 12:A69, 1945), which has the stress across the wall,

.. math:: D \nabla^4 w = q - \frac{t^2 (2 - \nu)}{10 (1 - \nu)} \nabla^2 q,

and by Mindlin's, with a shear factor k, the last term is t^2 / (6 k (1 - nu)): they agree for k = 5 / (6 (1 - nu / 2)).
"""

from __future__ import annotations

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.fem.elements.dkt import MIDSIDE_POINTS, SIDES, curvature_displacement, normal_rotations
from trocar.services.mechanics.fem.triangle import signed_areas

SHEAR_FACTOR = 5.0 / 6.0
"""As shear stresses are a parabola over the thickness (Reissner, 1945)."""


def stiffness(xy: FloatArray, D: FloatArray, thickness: FloatArray) -> FloatArray:
    """(m, 9, 9) bending stiffness of a plate that is loaded at its edges; see `element.StiffnessKernel`."""
    return _stiffness(xy, D, thickness, SHEAR_FACTOR * transverse_shear_modulus(D))


def stiffness_of_pressed_wall(xy: FloatArray, D: FloatArray, thickness: FloatArray) -> FloatArray:
    """(m, 9, 9) bending stiffness of a wall that is loaded on its faces; see `element.StiffnessKernel`."""
    poisson = D[:, 0, 1] / np.sqrt(D[:, 0, 0] * D[:, 1, 1])
    return _stiffness(xy, D, thickness, SHEAR_FACTOR / (1.0 - 0.5 * poisson) * transverse_shear_modulus(D))


def _stiffness(xy: FloatArray, D: FloatArray, thickness: FloatArray, shear_modulus: FloatArray) -> FloatArray:
    """(m, 9, 9) bending stiffness; ``shear_modulus`` (m,) is that across the wall times the shear factor.

    Shear and curvature are linear over the triangle: the three mid-side points integrate their energies exactly.
    """
    softness = side_softness(xy, D, shear_modulus, thickness)
    beta, gap = _rotations(xy, softness)
    of_shear = shear_modulus * thickness
    rigidity = thickness[:, None, None] ** 3 / 12.0 * D
    corner = _corner_shear(xy, -2.0 / 3.0 * softness[:, :, None] * gap)
    weight = signed_areas(xy)[:, None, None] / 3.0
    K = np.zeros((len(xy), 9, 9))
    for point, B in zip(MIDSIDE_POINTS, curvature_displacement(xy, beta), strict=True):
        shear = np.einsum("a,madi->mdi", point, corner)
        K += weight * (B.transpose(0, 2, 1) @ rigidity @ B)
        K += weight * of_shear[:, None, None] * (shear.transpose(0, 2, 1) @ shear)
    return K


def transverse_shear_modulus(D: FloatArray) -> FloatArray:
    """(m,) G of the wall across its thickness in Pa: of the same material, the mean over all directions in the plane.

    An assumption where the material is orthotropic: nothing is given of it out of its plane.
    """
    mean: FloatArray = (D[:, 0, 0] + D[:, 1, 1] - 2.0 * D[:, 0, 1] + 4.0 * D[:, 2, 2]) / 8.0
    return mean


def side_softness(xy: FloatArray, D: FloatArray, shear_modulus: FloatArray, thickness: FloatArray) -> FloatArray:
    """(m, 3) shear deflection of each side over its bending deflection: 12 D_b / (D_s L^2), zero for a thin plate."""
    softness = np.empty((len(xy), 3))
    for side, (i, j) in enumerate(SIDES):
        along = xy[:, j] - xy[:, i]
        square = np.einsum("md,md->m", along, along)
        x, y = (along / np.sqrt(square)[:, None]).T
        strain = np.stack([x * x, y * y, 2.0 * x * y], axis=1)
        along_side = np.einsum("mi,mij,mj->m", strain, D, strain)
        softness[:, side] = thickness**2 * along_side / (shear_modulus * square)
    return softness


def _rotations(xy: FloatArray, softness: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(m, 6, 2, 9) as of `dkt.normal_rotations`, and (m, 3, 9) what mid-sides rotate by beyond their ends' mean."""
    beta = normal_rotations(xy)
    gap = np.empty((len(xy), 3, 9))
    for side, (i, j) in enumerate(SIDES):
        along = xy[:, j] - xy[:, i]
        tangent = along / np.linalg.norm(along, axis=1, keepdims=True)
        mean = 0.5 * (beta[:, i] + beta[:, j])
        beyond = (beta[:, 3 + side] - mean) / (1.0 + softness[:, side])[:, None, None]
        beta[:, 3 + side] = mean + beyond
        gap[:, side] = np.einsum("md,mdi->mi", tangent, beyond)
    return beta, gap


def _corner_shear(xy: FloatArray, along_side: FloatArray) -> FloatArray:
    """(m, 3, 2, 9) shear strain at each corner, from those along the two sides that meet there."""
    corner = np.empty((len(xy), 3, 2, 9))
    for node in range(3):
        meeting = [side for side, ends in enumerate(SIDES) if node in ends]
        ways = np.stack([xy[:, SIDES[side][1]] - xy[:, SIDES[side][0]] for side in meeting], axis=1)
        tangents = ways / np.linalg.norm(ways, axis=2, keepdims=True)
        corner[:, node] = np.linalg.solve(tangents, along_side[:, meeting])
    return corner
