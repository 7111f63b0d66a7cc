"""Finite rotations of many nodes at once: exponential, logarithm, and the derivative of the logarithm."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from trocar.services.mechanics.arrays import FloatArray

SMALL_RAD = 0.05
"""Below it series to eighth order stand for quotients of differences that would lose digits."""


def skew(v: FloatArray) -> FloatArray:
    """(..., 3, 3) matrices S with S x = v cross x."""
    S = np.zeros((*v.shape, 3))
    S[..., 0, 1], S[..., 0, 2], S[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    S[..., 1, 0], S[..., 2, 0], S[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    return S


def exponential(v: FloatArray) -> FloatArray:
    """(..., 3, 3) rotation matrices of (..., 3) rotation vectors in rad."""
    matrices: FloatArray = Rotation.from_rotvec(v.reshape(-1, 3)).as_matrix().reshape(*v.shape, 3)
    return matrices


def logarithm(R: FloatArray) -> FloatArray:
    """(..., 3) rotation vectors of length at most pi from (..., 3, 3) rotation matrices."""
    vectors: FloatArray = Rotation.from_matrix(R.reshape(-1, 3, 3)).as_rotvec().reshape(R.shape[:-1])
    return vectors


def vector_rate(theta: FloatArray) -> FloatArray:
    """(..., 3, 3) H: rate of the rotation vector from the spin (spatial angular velocity).

    H = I - S / 2 + eta S², S = skew(theta), eta = (1 - (|theta| / 2) cot(|theta| / 2)) / |theta|²
    (Nour-Omid and Rankin, CMAME 93:353, 1991). Singular at a turn of 2 pi.
    """
    S = skew(theta)
    eta, _ = _eta_and_mu(np.linalg.norm(theta, axis=-1))
    H: FloatArray = np.eye(3) - 0.5 * S + eta[..., None, None] * (S @ S)
    return H


def moment_correction(theta: FloatArray, moment: FloatArray) -> FloatArray:
    """(..., 3, 3) L: rate of H(theta)^T moment from the spin at constant ``moment``, already times H.

    Felippa and Haugen, CMAME 194:2285 (2005), eq. 106.
    """
    eta, mu = _eta_and_mu(np.linalg.norm(theta, axis=-1))
    dot = np.sum(theta * moment, axis=-1)[..., None, None]
    outer = theta[..., :, None] * moment[..., None, :]
    S = skew(theta)
    squared = (S @ S @ moment[..., None]) * theta[..., None, :]
    rate = eta[..., None, None] * (dot * np.eye(3) + outer - 2.0 * outer.swapaxes(-1, -2))
    rate += mu[..., None, None] * squared - 0.5 * skew(moment)
    L: FloatArray = rate @ vector_rate(theta)
    return L


def _eta_and_mu(angle: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Eta of `vector_rate` and mu = (d eta / d angle) / angle."""
    a2 = angle * angle
    eta = 1.0 / 12.0 + a2 / 720.0 * (1.0 + a2 / 42.0 * (1.0 + a2 / 40.0))
    mu = 1.0 / 360.0 + a2 / 7560.0 * (1.0 + a2 / 26.666666666666668)
    large = angle > SMALL_RAD
    a = np.where(large, angle, 1.0)
    half = 0.5 * a
    eta = np.where(large, (1.0 - half / np.tan(half)) / (a * a), eta)
    mu = np.where(large, (a * a + 4.0 * np.cos(a) + a * np.sin(a) - 4.0) / (4.0 * a**4 * np.sin(half) ** 2), mu)
    return eta, mu
