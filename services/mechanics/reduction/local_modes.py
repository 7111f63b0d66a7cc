"""Residual vectors beside supports: extra modes for the part of the local response that the lowest modes leave out.

On the first row of nodes beside a clamp the lowest 80 modes hold a quarter of what a force moves the wall by. The
residual compliance holds the rest, exactly, but of a linear wall only: no force on the modes can soften or stiffen it.
So the responses of the residual to forces there are made modes (residual vectors: Dickens, Nakagawa and Wittbrodt,
Computers and Structures 62:985, 1997): of all such responses the few that hold most, orthogonal to all other modes by
mass and stiffness. What they hold the residual holds no longer; all together is as exact as before.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from services.mechanics.arrays import FloatArray, IntArray
from services.mechanics.fem import ShellModel
from services.mechanics.reduction.basis import ModalBasis
from services.mechanics.reduction.free_dofs import free_load, nodal_translations
from services.mechanics.reduction.softening.load_sites import lumen_width_m
from services.mechanics.surface.mesh import vertex_normals

REACH_WIDTHS = 0.5
"""Of the lumen: nodes so near a support are loaded."""
ALIKE = 1e-6
"""Two shapes that hold as much, within this, are turned copies of each other: both are taken or none, so that the modes
of a wall are as symmetric as it is."""
N_WIDTHS = 32
"""Nodes from which the lumen's width is taken."""


def with_local_modes(model: ShellModel, lowest: ModalBasis, n_most: int) -> tuple[ModalBasis, int]:
    """Add up to ``n_most`` modes beside supports to all modes but the last, or the last two if these are a pair.

    They come last, and are faster than all others; also returned is how many they are.
    """
    basis = _whole_pairs(lowest)
    nodes, inward = _beside_supports(model)
    loads = np.zeros((len(nodes), model.mesh.n_vertices, 3))
    loads[np.arange(len(nodes)), nodes] = inward
    moved = nodal_translations(model, model.factor.solve(np.stack([free_load(model, load) for load in loads], axis=1)))
    modal = np.einsum("nar,kna->rk", basis.Phi, loads, optimize=True) / basis.omega_rad_s[:, None] ** 2
    left = moved - basis.Phi @ modal
    compliance, of_it = (np.einsum("na,nak->nk", inward, u[nodes]) for u in (moved, left))
    shapes = left @ _that_hold_most(compliance, of_it, n_most)
    squares, turn = np.linalg.eigh(np.einsum("nak,n,nal->kl", shapes, model.mass_kg, shapes, optimize=True))
    omega = 1.0 / np.sqrt(squares[::-1])
    added = (shapes @ turn[:, ::-1]) * omega
    both = np.concatenate([basis.omega_rad_s, omega]), np.concatenate([basis.Phi, added], axis=2)
    return ModalBasis.from_modes(*both), len(omega)


def _whole_pairs(basis: ModalBasis) -> ModalBasis:
    """All modes but the last, and but the one before that if it is the same turned."""
    omega = basis.omega_rad_s
    r = basis.n_modes - 1
    r -= int(r > 1 and omega[r] - omega[r - 1] < ALIKE * omega[r])
    return ModalBasis.from_modes(omega[:r], basis.Phi[:, :, :r])


def _beside_supports(model: ShellModel) -> tuple[IntArray, FloatArray]:
    """Nodes (k,) beside supports, and unit forces (k, 3) inward on them."""
    mesh = model.mesh
    held = np.unique(model.held_dofs // 6)
    far = np.asarray(cKDTree(mesh.vertices_m[held]).query(mesh.vertices_m)[0])
    inward = -vertex_normals(mesh)
    nearest = np.setdiff1d(np.argsort(far, kind="stable")[: len(held) + N_WIDTHS], held)
    reach = REACH_WIDTHS * lumen_width_m(mesh, nearest, inward)
    nodes = np.setdiff1d(np.flatnonzero(far <= max(reach, far[nearest].min()) * (1.0 + ALIKE)), held).astype(np.int32)
    return nodes, inward[nodes]


def _that_hold_most(compliance: FloatArray, left: FloatArray, n_most: int) -> FloatArray:
    """(k, m) forces on the nodes whose residual responses hold most of what forces on single nodes do, of unit energy.

    ``compliance`` (k, k) is between the nodes, of it ``left`` (k, k) what the modes leave out.
    """
    scale = 1.0 / np.sqrt(np.diag(compliance))
    share, forces = np.linalg.eigh(scale[:, None] * 0.5 * (left + left.T) * scale)
    share, forces = share[::-1], forces[:, ::-1]
    m = min(n_most, int(np.sum(share > ALIKE * share[0])))
    while 0 < m < len(share) and share[m - 1] - share[m] < ALIKE * share[m - 1]:
        m -= 1
    most: FloatArray = scale[:, None] * forces[:, :m] / np.sqrt(share[:m])
    return most
