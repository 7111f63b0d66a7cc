"""Residual vectors: extra modes for part of the static response that the lowest modes leave out.

The residual compliance holds that response exactly, but of a linear wall only: no force on the modes can soften or
stiffen it. So what the modes leave of the responses to chosen loads is made modes (Dickens, Nakagawa and Wittbrodt,
Computers and Structures 62:985, 1997): of all such shapes the few that hold most, orthogonal to all other modes by mass
and stiffness. What they hold the residual holds no longer; all together is as exact as before.
"""

from __future__ import annotations

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.fem import ShellModel
from trocar.services.mechanics.reduction.basis import ModalBasis
from trocar.services.mechanics.reduction.free_dofs import free_load, nodal_translations

ALIKE = 1e-6
"""Two shapes that hold as much, within this, are turned copies of each other: both are taken or none, so that the modes
of a wall are as symmetric as it is."""


def add_residual_vectors(
    model: ShellModel, basis: ModalBasis, loads: FloatArray, n_most: int
) -> tuple[ModalBasis, int]:
    """Add up to ``n_most`` modes for the responses to ``loads`` (k, n, 3), each of which moves the wall.

    They come last, and are faster than all others; also returned is how many they are.
    """
    moved = nodal_translations(model, model.factor.solve(np.stack([free_load(model, load) for load in loads], axis=1)))
    modal = np.einsum("nar,kna->rk", basis.Phi, loads, optimize=True) / basis.omega_rad_s[:, None] ** 2
    left = moved - basis.Phi @ modal
    compliance, of_it = (np.einsum("kna,nal->kl", loads, u, optimize=True) for u in (moved, left))
    shapes = left @ _that_hold_most(compliance, of_it, n_most)
    squares, turn = np.linalg.eigh(np.einsum("nak,n,nal->kl", shapes, model.mass_kg, shapes, optimize=True))
    omega = 1.0 / np.sqrt(squares[::-1])
    added = (shapes @ turn[:, ::-1]) * omega
    both = np.concatenate([basis.omega_rad_s, omega]), np.concatenate([basis.Phi, added], axis=2)
    return ModalBasis.from_modes(*both), len(omega)


def whole_pairs(basis: ModalBasis) -> ModalBasis:
    """All modes but the last, and but the one before that if it is the same turned."""
    omega = basis.omega_rad_s
    r = basis.n_modes - 1
    r -= int(r > 1 and omega[r] - omega[r - 1] < ALIKE * omega[r])
    return ModalBasis.from_modes(omega[:r], basis.Phi[:, :, :r])


def _that_hold_most(compliance: FloatArray, left: FloatArray, n_most: int) -> FloatArray:
    """(k, m) combinations of loads whose residual responses hold most of what single loads do, of unit energy.

    ``compliance`` (k, k) is between the loads, of it ``left`` (k, k) what the modes leave out.
    """
    scale = 1.0 / np.sqrt(np.diag(compliance))
    share, forces = np.linalg.eigh(scale[:, None] * 0.5 * (left + left.T) * scale)
    share, forces = share[::-1], forces[:, ::-1]
    m = min(n_most, int(np.sum(share > ALIKE * share[0])))
    while 0 < m < len(share) and share[m - 1] - share[m] < ALIKE * share[m - 1]:
        m -= 1
    most: FloatArray = scale[:, None] * forces[:, :m] / np.sqrt(share[:m])
    return most
